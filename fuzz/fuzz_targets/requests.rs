//! The server's requests: any line is a request within its ranges, which is one again once it is written,
//! or is refused.
#![no_main]

use libfuzzer_sys::fuzz_target;
use pilot::serve::protocol::Request;

fuzz_target!(|data: &[u8]| {
    if let Ok(request) = Request::parse(data) {
        let line = serde_json::to_vec(&request).expect("a request is JSON");
        assert!(Request::parse(&line).is_ok(), "{request:?}");
    }
});
