//! The Pi's end of the link: any replies after each other. A frame is taken whole or changes nothing
//! but one counter.
#![no_main]

use fw_core::wire::{Command, MAX_FRAME, PiLink, frame_len};
use libfuzzer_sys::fuzz_target;
use robot_fuzz::{Bytes, frame, setup};

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes::new(data);
    let setup = setup(&mut bytes);
    let mut link = PiLink::new(setup);
    while bytes.more() {
        let received = frame(&mut bytes, setup.mode, setup.key_from_stm);
        let before = link.clone();
        let result = link.receive(&received);
        assert_eq!(link.counters().frames(), before.counters().frames() + 1);
        // What the next command looks like with and without that frame.
        let (mut one, mut other) = ([0; MAX_FRAME], [0; MAX_FRAME]);
        let length = link.send(&Command::default(), &mut one);
        before.clone().send(&Command::default(), &mut other);
        assert_eq!(length, frame_len(setup.mode));
        match result {
            Ok(report) => {
                assert_eq!(received.len(), frame_len(setup.mode));
                assert_eq!(received[0], setup.key_from_stm);
                assert!(report.cell.cell < setup.cells);
            }
            Err(error) => {
                assert!(usize::from(error.offset) <= MAX_FRAME, "{error}");
                assert_eq!(one, other, "a rejected frame showed in the next command");
            }
        }
    }
});
