//! Both ends and their modes: the host's code on the Pi's wires, the ELF behind them.

use fw_core::eeprom::Config;
use fw_core::wire::{Mode, chain};
use host_link::error::Error;
use host_link::session::{CommandRequest, MODE_CHECK_FRAMES, RATE_HZ, Session};
use pilot::mode;
use robot_tests::exploration::READY_MS;
use robot_tests::test_board::{Rig, image_with_servo};

fn names(mode: Mode) -> impl Iterator<Item = &'static str> {
    chain(mode).iter().map(|field| field.name())
}

// Requirement: DOC-3.2-2, DOC-5.2-1
#[test]
fn mode_mismatch_is_detected_within_ten_frames() {
    for &stm in Mode::ALL {
        let rig = Rig::in_mode(stm);
        for &pi in Mode::ALL {
            let mut machine = rig.io();
            let config = Config::decode(&image_with_servo(pi)).expect("accepted");
            let mut session = Session::with_config(&mut machine, config, RATE_HZ);
            let met = session.confirm_mode();
            let pair = format!("Pi {}, STM {}", pi.name(), stm.name());
            if names(pi).eq(names(stm)) {
                assert_eq!(met, Ok(()), "{pair}");
                continue;
            }
            let Err(Error::ModeMismatch { mode, frames, .. }) = &met else {
                panic!("{pair}: {met:?}");
            };
            assert!(*frames <= u64::from(MODE_CHECK_FRAMES), "{pair}: {met:?}");
            assert_eq!(*mode, pi.name());
        }
        rig.assert_logged("frame rejected");
        assert!(rig.truth().path_mm < 0.01, "STM {}", stm.name());
    }
}

// Requirement: DOC-5.2-2, DOC-5.2-1, DOC-5.2-3
#[test]
fn mode_change_takes_effect_on_both_ends() {
    let rig = Rig::in_mode(Mode::Normal);
    let mut machine = rig.io();
    let mut before = Mode::Normal;
    for &mode in Mode::ALL.iter().rev().chain([&Mode::GuardedNormal]) {
        let (was, programmed, mut session) =
            mode::change(&mut machine, mode, RATE_HZ, READY_MS, None, |_| {})
                .unwrap_or_else(|error| panic!("{}: {error}", mode.name()));
        assert_eq!(was, before);
        assert!(programmed.bytes > 0);
        assert_eq!(session.config().mode(), mode);
        let report = session.exchange(&CommandRequest::default());
        assert!(matches!(report, Ok(Some(_))), "{}: {report:?}", mode.name());
        rig.assert_logged(&format!("configured, mode {}", mode.name()));
        before = mode;
    }
    rig.assert_modelled();
}
