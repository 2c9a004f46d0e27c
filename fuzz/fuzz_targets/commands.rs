//! The STM's end of the link: any chip-selects after each other. A frame is taken whole or changes
//! nothing but one counter.
#![no_main]

use fw_core::wire::{Field, MAX_FRAME, Report, StmLink, frame_len};
use libfuzzer_sys::fuzz_target;
use robot_fuzz::{Bytes, frame, setup};

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes::new(data);
    let setup = setup(&mut bytes);
    let mut link = StmLink::new(setup);
    let mut reply = 1;
    while bytes.more() {
        let received = frame(&mut bytes, setup.mode, setup.key_from_pi);
        let before = link.clone();
        let result = link.receive(&received, 0, reply);
        assert_eq!(link.counters().frames(), before.counters().frames() + 1);
        match result {
            Ok(command) => {
                assert_eq!(received.len(), frame_len(setup.mode));
                assert_eq!(received[0], setup.key_from_pi);
                assert!(command.tune.cell < setup.cells);
                // A repeated frame is not fresh.
                if setup.mode.has(Field::Sequence) {
                    assert!(link.receive(&received, 0, reply).is_err());
                }
            }
            Err(error) => {
                assert!(usize::from(error.offset) <= MAX_FRAME, "{error}");
                let (mut one, mut other) = ([0; MAX_FRAME], [0; MAX_FRAME]);
                let report = Report::default();
                let len = link.encode_reply(reply, &report, &mut one);
                before.encode_reply(reply, &report, &mut other);
                assert_eq!(len, frame_len(setup.mode));
                assert_eq!(one, other, "a rejected frame showed in the reply");
            }
        }
        reply += 1;
    }
});
