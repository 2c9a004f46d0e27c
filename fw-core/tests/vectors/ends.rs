//! Both ends of the link, and what they send each other.

use crate::json::{Value, command, report};
use fw_core::wire::{Command, FrameError, LinkCounters, MAX_FRAME, PiLink, Report, Setup, StmLink};

/// What a frame carries.
#[derive(Debug, PartialEq)]
pub enum Message {
    FromPi(Command),
    FromStm(Report),
}

impl Message {
    pub fn new(is_command: bool, values: &Value) -> Self {
        if is_command {
            Self::FromPi(command(values))
        } else {
            Self::FromStm(report(values))
        }
    }

    /// Default values.
    pub fn at_rest(is_command: bool) -> Self {
        Self::new(is_command, &serde_json::json!({}))
    }
}

pub struct Ends {
    pub pi: PiLink,
    pub stm: StmLink,
    /// Number of the STM's last frame.
    pub reply: u32,
}

impl Ends {
    pub fn new(setup: Setup) -> Self {
        Self {
            pi: PiLink::new(setup),
            stm: StmLink::new(setup),
            reply: 0,
        }
    }

    pub fn send(&mut self, message: &Message) -> Vec<u8> {
        match message {
            Message::FromPi(command) => {
                let mut frame = [0xEE; MAX_FRAME];
                let len = self.pi.send(command, &mut frame);
                frame[..len].to_vec()
            }
            Message::FromStm(report) => {
                self.reply += 1;
                self.encode_reply(report)
            }
        }
    }

    /// The STM's last frame with this report.
    pub fn encode_reply(&self, report: &Report) -> Vec<u8> {
        let mut frame = [0xEE; MAX_FRAME];
        let len = self.stm.encode_reply(self.reply, report, &mut frame);
        frame[..len].to_vec()
    }

    /// The frame at the other end, which the STM has cut off after its buffer's length.
    pub fn receive(
        &mut self,
        is_command: bool,
        frame: &[u8],
        overflow_len: usize,
    ) -> Result<Message, FrameError> {
        if is_command {
            let received = self.stm.receive(frame, overflow_len, self.reply + 1);
            received.map(Message::FromPi)
        } else {
            assert_eq!(overflow_len, 0);
            self.pi.receive(frame).map(Message::FromStm)
        }
    }

    pub fn counters(&self, of_pi: bool) -> &LinkCounters {
        if of_pi {
            self.pi.counters()
        } else {
            self.stm.counters()
        }
    }
}
