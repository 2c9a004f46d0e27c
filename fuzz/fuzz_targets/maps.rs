//! Any metadata and, behind a zero byte, any picture as a saved map: refused by name, or a grid of the
//! picture's size.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapper::ros::read;

fuzz_target!(|data: &[u8]| {
    let end = data.iter().position(|&byte| byte == 0);
    let (yaml, picture) = data.split_at(end.unwrap_or(data.len()));
    let yaml = String::from_utf8_lossy(yaml);
    let picture = picture.get(1..).unwrap_or_default();
    match read(&yaml, picture) {
        // A border and a padding may come on top of the pixels.
        Ok(grid) => {
            assert!(grid.columns().min(grid.rows()) > 0);
            assert!(grid.columns() + grid.rows() <= 2 * picture.len() + 4096);
        }
        Err(what) => assert!(!what.is_empty()),
    }
});
