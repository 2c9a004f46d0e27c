//! The guarded link under every disturbance of its wires, through the ELF.
//!
//! Every disturbed frame asks the robot to drive off, every good one asks for nothing: a robot that
//! took a single wrong one for right would move. What it accepted it says itself, in the next
//! reply; how many it rejected it says in its log.

use fw_core::eeprom;
use fw_core::wire::{Command, Order, PiLink, PoseCode, Setup, MAX_FRAME};
use robot_tests::reference::image_in_mode;
use robot_tests::test_board::Rig;
use twin::components::spi_master::pack;
use twin::SpiStep;

/// Frames that the test sends unless [`MORE`] says otherwise.
const FRAMES: usize = 100_000;
/// Environment variable with another number of frames, for a longer run.
const MORE: &str = "ROBOT_LINK_FRAMES";
/// Frames played at a time. The numbers of a frame tell fresh from old over 127.
const BATCH: usize = 64;
/// From a frame's end to the next one's begin, nanoseconds.
const GAP_NS: u64 = 20_000;
/// From the chip select's edge to the clocks, and back, nanoseconds.
const SETUP_NS: u64 = 1_000;
/// Bytes of a Guarded Normal frame.
const LEN: usize = 26;
const BITS: usize = 8 * LEN;
/// Clock rates, hertz, and how often each comes: the slow ones take the most time.
const CLOCKS: [(u64, usize); 8] = [
    (100_000, 1),
    (400_000, 1),
    (1_000_000, 2),
    (4_000_000, 4),
    (8_000_000, 8),
    (12_000_000, 8),
    (16_000_000, 8),
    (25_000_000, 8),
];
/// Wrong bits, of a million.
const RATES: [u64; 5] = [1, 10, 100, 1_000, 10_000];

/// A generator of Weyl steps, mixed (`SplitMix64`).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ mixed >> 31
    }

    /// 0 ..= below − 1.
    fn below(&mut self, below: usize) -> usize {
        let scaled = (u128::from(self.next()) * below as u128) >> 64;
        usize::try_from(scaled).expect("below a usize")
    }

    fn clock(&mut self) -> u64 {
        let mut left = self.below(CLOCKS.iter().map(|(_, often)| often).sum());
        for (hz, often) in CLOCKS {
            if left < often {
                return hz;
            }
            left -= often;
        }
        unreachable!("below the sum")
    }

    /// The bits of a frame that are wrong at a rate.
    fn wrong_bits(&mut self, of_a_million: u64) -> Vec<usize> {
        (0..BITS)
            .filter(|_| (self.below(1_000_000) as u64) < of_a_million)
            .collect()
    }
}

/// What happens to a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Fate {
    Good,
    /// Ends before its last byte.
    Short(usize),
    /// Goes on after its last byte.
    Long(usize),
    /// Ends inside a byte, after so many bits.
    Torn(usize),
    /// The chip select falls and rises, and nothing is clocked.
    Glitch,
    /// The chip select rises for a microsecond after so many bits.
    Parted(usize),
    /// These bits arrive wrong at the STM, those at the Pi.
    Noise(Vec<usize>, Vec<usize>),
}

impl Fate {
    fn bad(random: &mut Random) -> Self {
        match random.below(8) {
            0 => Self::Short(1 + random.below(LEN - 1)),
            1 => Self::Long(1 + random.below(64)),
            2 => Self::Torn(8 * random.below(LEN) + 1 + random.below(7)),
            3 => Self::Glitch,
            4 => Self::Parted(8 + random.below(BITS - 16)),
            _ => {
                let rate = RATES[random.below(RATES.len())];
                Self::Noise(random.wrong_bits(rate), random.wrong_bits(rate))
            }
        }
    }

    fn reaches_the_stm_whole(&self) -> bool {
        match self {
            Self::Good => true,
            Self::Noise(there, _) => there.is_empty(),
            _ => false,
        }
    }

    fn reaches_the_pi_whole(&self) -> bool {
        match self {
            Self::Good => true,
            Self::Noise(_, back) => back.is_empty(),
            _ => false,
        }
    }

    /// Frames that the STM rejects of it.
    fn rejections(&self) -> usize {
        match self {
            Self::Parted(_) => 2,
            _ => usize::from(!self.reaches_the_stm_whole()),
        }
    }

    fn name(&self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Short(_) => "short",
            Self::Long(_) => "long",
            Self::Torn(_) => "torn",
            Self::Glitch => "glitch",
            Self::Parted(_) => "parted",
            Self::Noise(there, _) if !there.is_empty() => "noise to the STM",
            Self::Noise(_, back) if !back.is_empty() => "noise to the Pi",
            Self::Noise(..) => "noise that spared it",
        }
    }
}

/// A frame on its way.
struct Frame {
    fate: Fate,
    number: u8,
    clocks: usize,
}

/// The Pi's end, and what the robot must have made of what it got.
struct Pi {
    end: PiLink,
    random: Random,
    /// The number of the last good frame as of the frame before this one, and of the two before
    /// that: replies are armed ahead, and a busy robot's may be as old as those.
    accepted: [u8; 3],
    counts: Vec<(&'static str, usize)>,
    rejections: usize,
    frames: usize,
    /// Replies that did not tell of the frame before theirs yet.
    late: usize,
    /// Replies put together from two that the checksum let through.
    spliced: usize,
}

impl Pi {
    fn new(seed: u64) -> Self {
        let image = image_in_mode(0x10);
        let config = eeprom::decode(image.first_chunk().expect("an image")).expect("accepted");
        Self {
            end: PiLink::new(Setup::from(&config)),
            random: Random(seed),
            accepted: [0; 3],
            counts: Vec::new(),
            rejections: 0,
            frames: 0,
            late: 0,
            spliced: 0,
        }
    }

    /// Puts a frame on the wires.
    fn play(&mut self, fate: Fate, steps: &mut Vec<SpiStep>) -> Frame {
        let command = if fate.reaches_the_stm_whole() {
            Command::default()
        } else {
            Command {
                expected: PoseCode {
                    x: 300_000,
                    ..PoseCode::default()
                },
                apply: true,
                order: Order::Resume,
                ..Command::default()
            }
        };
        let mut out = [0; MAX_FRAME];
        let len = self.end.send(&command, &mut out);
        assert_eq!(len, LEN);
        let hz = self.random.clock();
        let mut bytes = out.to_vec();
        if let Fate::Long(more) = fate {
            bytes.extend((0..more).map(|_| self.random.next().to_le_bytes()[0]));
        }
        let SpiStep::Bits { mut mosi, .. } = SpiStep::bytes(&bytes, hz) else {
            unreachable!("bytes are bits")
        };
        match &fate {
            Fate::Short(less) => mosi.truncate(8 * (LEN - less)),
            Fate::Torn(bits) => mosi.truncate(*bits),
            Fate::Glitch => mosi.clear(),
            Fate::Noise(there, _) => there.iter().for_each(|&bit| mosi[bit] ^= true),
            _ => {}
        }
        let clocks = mosi.len();
        let rest = match fate {
            Fate::Parted(bits) => Some(mosi.split_off(bits)),
            _ => None,
        };
        for (mosi, wait) in [(Some(mosi), GAP_NS), (rest, 1_000)] {
            let Some(mosi) = mosi else { continue };
            steps.extend([SpiStep::Wait(wait), SpiStep::Select(true)]);
            if fate == Fate::Glitch {
                steps.push(SpiStep::Wait(200));
            } else {
                steps.push(SpiStep::Wait(SETUP_NS));
                steps.push(SpiStep::Bits { mosi, hz });
                steps.push(SpiStep::Wait(SETUP_NS));
            }
            steps.push(SpiStep::Select(false));
        }
        Frame {
            number: out[1],
            fate,
            clocks,
        }
    }

    /// Looks at what came back with a frame.
    #[track_caller]
    fn judge(&mut self, frame: &Frame, miso: &[bool]) {
        let mut miso = miso.to_vec();
        if let Fate::Noise(_, back) = &frame.fate {
            for &bit in back {
                miso[bit] ^= true;
            }
        }
        let reply = self.end.receive(&pack(&miso));
        // Two parts of different replies are a burst of errors longer than the checksum's 16 bits,
        // and 1 in 65 536 of those has the right one: counted, and held to that share at the end.
        let spliced = matches!(frame.fate, Fate::Parted(_)) && reply.is_ok();
        self.spliced += usize::from(spliced);
        assert_eq!(
            reply.is_ok() && !spliced,
            frame.fate.reaches_the_pi_whole(),
            "frame {} {:?}: {reply:?}",
            self.frames,
            frame.fate
        );
        if let Ok(report) = reply {
            let seen = report.sequence.seen;
            self.late += usize::from(seen != self.accepted[0]);
            assert!(
                self.accepted.contains(&seen),
                "frame {} {:?}: the robot says it accepted {seen}, the good ones were {:?}",
                self.frames,
                frame.fate,
                self.accepted
            );
        }
        let [last, before, _] = self.accepted;
        let next = if frame.fate.reaches_the_stm_whole() {
            frame.number
        } else {
            last
        };
        self.accepted = [next, last, before];
        self.rejections += frame.fate.rejections();
        self.frames += 1;
        let name = frame.fate.name();
        match self.counts.iter_mut().find(|(known, _)| *known == name) {
            Some((_, count)) => *count += 1,
            None => self.counts.push((name, 1)),
        }
    }

    fn count(&self, name: &str) -> usize {
        let known = self.counts.iter().find(|(known, _)| *known == name);
        known.map_or(0, |(_, count)| *count)
    }

    /// Plays frames of these fates, 20 µs apart.
    #[track_caller]
    fn exchange(&mut self, rig: &Rig, fates: impl IntoIterator<Item = Fate>) {
        let mut steps = Vec::new();
        let frames: Vec<_> = fates
            .into_iter()
            .map(|fate| self.play(fate, &mut steps))
            .collect();
        let miso = rig.board.spi_steps(steps);
        let mut rest = &miso[..];
        // A batch begins after a pause: the robot has come to everything before.
        self.accepted = [self.accepted[0]; 3];
        for frame in &frames {
            let (own, others) = rest.split_at(frame.clocks);
            rest = others;
            self.judge(frame, own);
        }
        rig.board.run_us(100);
    }
}

fn guarded() -> Rig {
    let rig = Rig::booted(Some(image_in_mode(0x10)));
    assert!(rig.board.is_ready(), "{}", rig.log());
    rig.board.run_us(100_000);
    rig
}

/// What the log says: frames rejected, and frames that came too fast.
fn told(log: &str) -> (usize, usize) {
    let mut told = (0, 0);
    for line in log.lines() {
        let text = line.split_once(": ").map_or("", |(_, text)| text);
        let number = || {
            text.split(' ')
                .next()
                .and_then(|n| n.parse().ok())
                .unwrap_or(0)
        };
        if text.starts_with("frame rejected: ") {
            told.0 += 1;
        } else if text.ends_with(" more frames rejected") {
            told.0 += number();
        } else if text.ends_with(" frames lost: not read before the next one") {
            told.1 += number();
        }
    }
    told
}

/// The robot stands where it stood, was not restarted, and its log tells of every rejected frame.
#[track_caller]
fn assert_unmoved(rig: &Rig, pi: &Pi) {
    rig.board.run_us(2_100_000);
    assert!(rig.board.truth().path_mm < 0.01, "a bad frame was obeyed");
    assert_eq!(rig.board.resets().len(), 0, "{:?}", rig.board.resets());
    let log = rig.log();
    // Of a parted frame the robot may only come to see the second part.
    let (rejected, lost) = told(&log);
    assert_eq!(rejected + lost, pi.rejections, "{log}");
    assert!(lost <= pi.count("parted"), "{log}");
    rig.assert_modelled();
}

// Requirement: WIRE-spi-2, WIRE-spi-5, WIRE-crc-2
#[test]
fn no_disturbed_frame_is_accepted_and_every_good_one_is() {
    let frames = std::env::var(MORE).map_or(FRAMES, |count| count.parse().expect("a number"));
    let rig = guarded();
    let mut pi = Pi::new(1);
    while pi.frames < frames {
        let mut fates = Vec::new();
        while fates.len() < BATCH - 8 {
            let bad = pi.random.below(4);
            let good = 1 + pi.random.below(4);
            fates.extend((0..bad).map(|_| Fate::bad(&mut pi.random)));
            fates.extend((0..good).map(|_| Fate::Good));
        }
        pi.exchange(&rig, fates);
    }
    println!(
        "{} frames: {:?}; {} told of a frame late, {} spliced replies passed",
        pi.frames, pi.counts, pi.late, pi.spliced
    );
    // Expected is one in 65 536; three times that and two more would be no accident.
    let share = 2 + 3 * pi.count("parted") / 65_536;
    assert!(pi.spliced <= share, "{} spliced replies passed", pi.spliced);
    assert_unmoved(&rig, &pi);
}
