//! Both ends step by step: sequence numbers over lost, repeated and torn frames and restarts.

use crate::json::{
    Value, bytes, command, essence, file, int, list, rejection, report, setup, text,
};
use fw_core::wire::{
    Cause, Command, LinkCounters, MAX_FRAME, PiLink, Report, Sequence, Setup, StmLink,
};

struct Session {
    setup: Setup,
    pi: PiLink,
    stm: StmLink,
    /// Number of the STM's last frame.
    reply: u32,
}

impl Session {
    fn new(setup: Setup) -> Self {
        Self {
            setup,
            pi: PiLink::new(setup),
            stm: StmLink::new(setup),
            reply: 0,
        }
    }

    fn step(&mut self, step: &Value) {
        let is_pi = step["end"] == "pi";
        let values = &step["values"];
        let mut out = [0xEE; MAX_FRAME];
        match text(step, "do") {
            "start" if is_pi => self.pi = PiLink::new(self.setup),
            "start" => (self.stm, self.reply) = (StmLink::new(self.setup), 0),
            "send" if is_pi => {
                let len = self.pi.send(&command(values), &mut out);
                assert_eq!(out[..len], bytes(step));
            }
            "send" => {
                self.reply += 1;
                self.encode_reply(step);
            }
            "resend" => self.encode_reply(step),
            "receive" => self.receive(step, is_pi),
            "exchange" => {
                let ways = (step["to_stm"] == true, step["to_pi"] == true);
                self.exchange(int(step, "times"), ways);
            }
            "counters" => {
                let counters = if is_pi {
                    self.pi.counters()
                } else {
                    self.stm.counters()
                };
                check(counters, &step["counters"]);
            }
            other => panic!("step {other}"),
        }
    }

    /// Encodes the reply twice: the number decides, not the order.
    fn encode_reply(&self, step: &Value) {
        for _ in 0..2 {
            let mut out = [0xEE; MAX_FRAME];
            let report = report(&step["values"]);
            let len = self.stm.encode_reply(self.reply, &report, &mut out);
            assert_eq!(out[..len], bytes(step));
        }
    }

    fn receive(&mut self, step: &Value, is_pi: bool) {
        let frame = bytes(step);
        let refused = match (is_pi, step["values"].is_null()) {
            (true, false) => {
                assert_eq!(self.pi.receive(&frame), Ok(report(&step["values"])));
                return;
            }
            (false, false) => {
                let received = self.stm.receive(&frame, 0, self.reply + 1);
                assert_eq!(received, Ok(command(&step["values"])));
                return;
            }
            (true, true) => self.pi.receive(&frame).unwrap_err(),
            (false, true) => self.stm.receive(&frame, 0, self.reply + 1).unwrap_err(),
        };
        assert_eq!(essence(&refused), rejection(&step["rejected"]));
    }

    /// Chip-selects at rest; the reply was written before the command arrives.
    fn exchange(&mut self, times: u16, (to_stm, to_pi): (bool, bool)) {
        for _ in 0..times {
            let (mut there, mut back) = ([0; MAX_FRAME], [0; MAX_FRAME]);
            let len = self.pi.send(&Command::default(), &mut there);
            let ready = Report {
                state: fw_core::wire::State::Ready,
                ..Report::default()
            };
            self.reply += 1;
            assert_eq!(self.stm.encode_reply(self.reply, &ready, &mut back), len);
            if to_stm {
                let received = self.stm.receive(&there[..len], 0, self.reply + 1);
                let mut command = received.expect("accepted");
                command.sequence = Sequence::default();
                assert_eq!(command, Command::default());
            }
            if to_pi {
                self.pi.receive(&back[..len]).expect("accepted");
            }
        }
    }
}

fn check(counters: &LinkCounters, expected: &Value) {
    assert_eq!(counters.accepted, int::<u32>(expected, "accepted"));
    assert_eq!(counters.missed, int::<u32>(expected, "missed"));
    for cause in Cause::ALL {
        let count = expected["rejected"][cause.name()].as_u64().unwrap_or(0);
        let rejected = u64::from(counters.rejected(cause));
        assert_eq!(rejected, count, "{}", cause.name());
    }
}

// Requirement: WIRE-sequence-2, WIRE-sequence-4
#[test]
fn sessions_match_vectors() {
    for session in list(&file("sessions")) {
        let name = text(session, "name");
        let mut ends = Session::new(setup(session));
        for (number, step) in list(&session["steps"]).iter().enumerate() {
            let run = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| ends.step(step)));
            let mode = &session["mode"];
            assert!(run.is_ok(), "{name}, mode {mode}, step {number}: {step}");
        }
    }
}
