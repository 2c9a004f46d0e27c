//! The STM's end of the link: any chip-selects after each other. A frame is taken whole or changes
//! nothing but one counter.
#![no_main]

use fw_core::wire::{frame_len, Report, StmLink, MAX_FRAME};
use libfuzzer_sys::fuzz_target;
use robot_fuzz::{frame, setup, Bytes};

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes::new(data);
    let setup = setup(&mut bytes);
    let mut link = StmLink::new(setup);
    let mut out = [0; MAX_FRAME];
    while bytes.more() {
        let received = frame(&mut bytes, setup.mode, setup.key_from_pi);
        let before = link.clone();
        let result = link.receive(&received);
        assert_eq!(link.counters().frames(), before.counters().frames() + 1);
        match result {
            Ok(command) => {
                assert_eq!(received.len(), frame_len(setup.mode));
                assert_eq!(received[0], setup.key_from_pi);
                assert!(command.tune.cell < setup.cells);
                // What was said just now is not fresh a second time.
                if setup.mode.tells_fresh() {
                    assert!(link.receive(&received).is_err());
                }
            }
            Err(error) => {
                assert!(error.offset <= MAX_FRAME, "{error}");
                let (mut one, mut other) = ([0; MAX_FRAME], [0; MAX_FRAME]);
                let report = Report::default();
                link.resend(&report, &mut one);
                before.resend(&report, &mut other);
                assert_eq!(one, other, "a rejected frame showed in the reply");
            }
        }
        assert_eq!(
            link.send(&Report::default(), &mut out),
            frame_len(setup.mode)
        );
    }
});
