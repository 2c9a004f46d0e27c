//! Noise on the guarded link: no corrupted frame is accepted, and the good frame after it is.
//!
//! Errors of up to three bits and bursts of up to 16 are excluded by properties in `proofs/`. Of other
//! errors about one in 2¹⁵ passes the checksum: here they are rarer than that or counted.

use fastrand::Rng;
use fw_core::wire::{Command, Field, MAX_FRAME, Mode, PiLink, Report, Setup, StmLink, frame_len};

/// Corrupted frames of each kind, direction and mode.
const FRAMES: u32 = 150_000;

type Corrupt = fn(&mut Vec<u8>, &mut Rng);

fn flip(frame: &mut [u8], bit: usize) {
    frame[bit / 8] ^= 0x80 >> (bit % 8);
}

/// So many bits, or two, four or six more.
fn flip_some(frame: &mut [u8], least: usize, random: &mut Rng) {
    for _ in 0..least + 2 * random.usize(..4) {
        flip(frame, random.usize(..8 * frame.len()));
    }
}

/// From some bit on everything arrives one bit late: a clock edge was counted twice.
fn slip(frame: &mut [u8], random: &mut Rng) {
    let before = frame.to_vec();
    let bit = |at: usize| before[at / 8] & 0x80 >> (at % 8) != 0;
    for at in random.usize(..8 * before.len() - 1) + 1..8 * before.len() {
        if bit(at - 1) != bit(at) {
            flip(frame, at);
        }
    }
}

/// Each kind of corruption, and of how many frames one may be accepted.
const KINDS: [(&str, Corrupt, Option<u32>); 6] = [
    (
        "odd number of bits",
        |frame, random| flip_some(frame, 1, random),
        None,
    ),
    (
        "burst",
        |frame, random| {
            let len = 1 + random.usize(..16);
            let first = random.usize(..=8 * frame.len() - len);
            flip(frame, first);
            for bit in first + 1..first + len {
                if random.bool() {
                    flip(frame, bit);
                }
            }
        },
        None,
    ),
    (
        "shortened",
        |frame, random| frame.truncate(random.usize(..frame.len())),
        None,
    ),
    (
        "lengthened",
        |frame, random| {
            for _ in 0..=random.usize(..64) {
                frame.push(random.u8(..));
            }
        },
        None,
    ),
    (
        "even number of bits",
        |frame, random| flip_some(frame, 4, random),
        Some(1 << 14),
    ),
    (
        "slipped",
        |frame, random| slip(frame, random),
        Some(1 << 14),
    ),
];

struct Ends {
    pi: PiLink,
    stm: StmLink,
    reply: u32,
}

impl Ends {
    fn new(mode: Mode) -> Self {
        let setup = Setup::first_board(mode);
        Self {
            pi: PiLink::new(setup),
            stm: StmLink::new(setup),
            reply: 0,
        }
    }

    fn frame(&mut self, to_stm: bool) -> Vec<u8> {
        let mut out = [0; MAX_FRAME];
        let len = if to_stm {
            self.pi.send(&Command::default(), &mut out)
        } else {
            self.reply += 1;
            let report = Report::default();
            self.stm.encode_reply(self.reply, &report, &mut out)
        };
        out[..len].to_vec()
    }

    fn accepts(&mut self, to_stm: bool, frame: &[u8]) -> bool {
        if to_stm {
            self.stm.receive(frame, 0, self.reply).is_ok()
        } else {
            self.pi.receive(frame).is_ok()
        }
    }
}

/// How many corrupted frames were accepted. A good one comes after every hundredth and must be.
fn accepted(mode: Mode, to_stm: bool, corrupt: Corrupt) -> u32 {
    let mut random = Rng::with_seed(mode.code().into());
    let mut ends = Ends::new(mode);
    let mut accepted = 0;
    for count in 1..=FRAMES {
        let sent = ends.frame(to_stm);
        let mut arrived = sent.clone();
        corrupt(&mut arrived, &mut random);
        if arrived != sent && ends.accepts(to_stm, &arrived) {
            accepted += 1;
            // A wrong number may have been taken over.
            ends = Ends::new(mode);
        }
        if count % 100 == 0 {
            let good = ends.frame(to_stm);
            assert_eq!(good.len(), frame_len(mode));
            assert!(ends.accepts(to_stm, &good), "{good:02X?}");
        }
    }
    accepted
}

#[test]
fn corrupted_guarded_frames_are_rejected() {
    for (kind, corrupt, one_in) in KINDS {
        let mut total = 0;
        let mut frames = 0;
        for &mode in Mode::ALL.iter().filter(|mode| mode.has(Field::Crc)) {
            for to_stm in [true, false] {
                total += accepted(mode, to_stm, corrupt);
                frames += FRAMES;
            }
        }
        let most = one_in.map_or(0, |one_in| frames / one_in);
        assert!(total <= most, "{kind}: {total} of {frames}");
    }
}
