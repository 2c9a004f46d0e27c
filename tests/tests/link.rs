//! The guarded link under every disturbance of its signals, through the ELF.
//!
//! Every disturbed frame commands a motion, every good one none: a robot that accepts a disturbed
//! frame moves. The replies report the accepted frames, the log counts the rejected ones.

use fw_core::eeprom::{Config, Image};
use fw_core::wire::{Command, Order, PiLink, PoseCode, MAX_FRAME};
use robot_tests::reference::image_in_mode;
use robot_tests::test_board::Rig;
use twin::components::spi_master::pack;
use twin::plant::Rng;
use twin::SpiStep;

/// Frames that the test sends unless [`MORE`] says otherwise.
const FRAMES: usize = 100_000;
/// Environment variable with another number of frames, for a longer run.
const MORE: &str = "ROBOT_LINK_FRAMES";
/// Frames played at a time. The sequence numbers distinguish fresh from old over 127 frames.
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

struct Random(Rng);

impl Random {
    /// 0 ..= below − 1.
    fn below(&mut self, below: usize) -> usize {
        let scaled = (u128::from(self.0.next_u64()) * below as u128) >> 64;
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

/// The disturbance of a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Disturbance {
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
    Split(usize),
    /// These bits arrive wrong at the STM, those at the Pi.
    Noise(Vec<usize>, Vec<usize>),
}

impl Disturbance {
    fn bad(random: &mut Random) -> Self {
        match random.below(8) {
            0 => Self::Short(1 + random.below(LEN - 1)),
            1 => Self::Long(1 + random.below(64)),
            2 => Self::Torn(8 * random.below(LEN) + 1 + random.below(7)),
            3 => Self::Glitch,
            4 => Self::Split(8 + random.below(BITS - 16)),
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
            Self::Split(_) => 2,
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
            Self::Split(_) => "split",
            Self::Noise(there, _) if !there.is_empty() => "noise to the STM",
            Self::Noise(_, back) if !back.is_empty() => "noise to the Pi",
            Self::Noise(..) => "noise that spared it",
        }
    }
}

/// A frame in transfer.
struct Frame {
    disturbance: Disturbance,
    number: u8,
    clocks: usize,
}

/// The Pi's end, and the expected state of the robot's.
struct PiEnd {
    end: PiLink,
    random: Random,
    /// The number of the last good frame as of the frame before this one, and of the two before
    /// that: replies are armed ahead, and a busy robot's may be as old as those.
    accepted: [u8; 3],
    counts: Vec<(&'static str, usize)>,
    rejections: usize,
    frames: usize,
    /// Replies that do not acknowledge the frame before theirs yet.
    late: usize,
    /// Replies put together from two that the checksum let through.
    spliced: usize,
}

impl PiEnd {
    fn new(seed: u64) -> Self {
        let image = image_in_mode(0x10);
        let image = Image(*image.first_chunk().expect("an image"));
        let config = Config::decode(&image).expect("accepted");
        Self {
            end: PiLink::new(config.link_setup()),
            random: Random(Rng::new(seed)),
            accepted: [0; 3],
            counts: Vec::new(),
            rejections: 0,
            frames: 0,
            late: 0,
            spliced: 0,
        }
    }

    /// Puts a frame on the wires.
    fn play(&mut self, disturbance: Disturbance, steps: &mut Vec<SpiStep>) -> Frame {
        let command = if disturbance.reaches_the_stm_whole() {
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
        if let Disturbance::Long(more) = disturbance {
            bytes.extend((0..more).map(|_| self.random.0.next_u64().to_le_bytes()[0]));
        }
        let SpiStep::Bits { mut mosi, .. } = SpiStep::bytes(&bytes, hz) else {
            unreachable!("bytes are bits")
        };
        match &disturbance {
            Disturbance::Short(less) => mosi.truncate(8 * (LEN - less)),
            Disturbance::Torn(bits) => mosi.truncate(*bits),
            Disturbance::Glitch => mosi.clear(),
            Disturbance::Noise(there, _) => there.iter().for_each(|&bit| mosi[bit] ^= true),
            _ => {}
        }
        let clocks = mosi.len();
        let rest = match disturbance {
            Disturbance::Split(bits) => Some(mosi.split_off(bits)),
            _ => None,
        };
        for (mosi, wait) in [(Some(mosi), GAP_NS), (rest, 1_000)] {
            let Some(mosi) = mosi else { continue };
            steps.extend([SpiStep::Wait(wait), SpiStep::Select(true)]);
            if disturbance == Disturbance::Glitch {
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
            disturbance,
            clocks,
        }
    }

    /// Checks the reply to a frame.
    #[track_caller]
    fn check_reply(&mut self, frame: &Frame, miso: &[bool]) {
        let mut miso = miso.to_vec();
        if let Disturbance::Noise(_, back) = &frame.disturbance {
            for &bit in back {
                miso[bit] ^= true;
            }
        }
        let reply = self.end.receive(&pack(&miso));
        // Two parts of different replies are a burst of errors longer than the checksum's 16 bits,
        // and 1 in 65 536 of those has the right one: counted, and held to that share at the end.
        let spliced = matches!(frame.disturbance, Disturbance::Split(_)) && reply.is_ok();
        self.spliced += usize::from(spliced);
        assert_eq!(
            reply.is_ok() && !spliced,
            frame.disturbance.reaches_the_pi_whole(),
            "frame {} {:?}: {reply:?}",
            self.frames,
            frame.disturbance
        );
        if let Ok(report) = reply {
            let seen = report.sequence.seen;
            self.late += usize::from(seen != self.accepted[0]);
            assert!(
                self.accepted.contains(&seen),
                "frame {} {:?}: the robot says it accepted {seen}, the good ones were {:?}",
                self.frames,
                frame.disturbance,
                self.accepted
            );
        }
        let [last, before, _] = self.accepted;
        let next = if frame.disturbance.reaches_the_stm_whole() {
            frame.number
        } else {
            last
        };
        self.accepted = [next, last, before];
        self.rejections += frame.disturbance.rejections();
        self.frames += 1;
        let name = frame.disturbance.name();
        match self.counts.iter_mut().find(|(known, _)| *known == name) {
            Some((_, count)) => *count += 1,
            None => self.counts.push((name, 1)),
        }
    }

    fn count(&self, name: &str) -> usize {
        let known = self.counts.iter().find(|(known, _)| *known == name);
        known.map_or(0, |(_, count)| *count)
    }

    /// Plays frames of these disturbances, 20 µs apart.
    #[track_caller]
    fn exchange(&mut self, rig: &Rig, disturbances: impl IntoIterator<Item = Disturbance>) {
        let mut steps = Vec::new();
        let frames: Vec<_> = disturbances
            .into_iter()
            .map(|disturbance| self.play(disturbance, &mut steps))
            .collect();
        let miso = rig.spi_steps(steps);
        let mut rest = &miso[..];
        // A batch begins after a pause: the robot has come to everything before.
        self.accepted = [self.accepted[0]; 3];
        for frame in &frames {
            let (own, others) = rest.split_at(frame.clocks);
            rest = others;
            self.check_reply(frame, own);
        }
        rig.run_us(100);
    }
}

fn guarded() -> Rig {
    let rig = Rig::configured(image_in_mode(0x10));
    rig.run_us(100_000);
    rig
}

/// The log's counts: frames rejected, and frames lost because they came too fast.
fn logged_counts(log: &str) -> (usize, usize) {
    let mut counts = (0, 0);
    for line in log.lines() {
        let text = line.split_once(": ").map_or("", |(_, text)| text);
        let number = || {
            text.split(' ')
                .next()
                .and_then(|n| n.parse().ok())
                .unwrap_or(0)
        };
        if text.starts_with("frame rejected: ") {
            counts.0 += 1;
        } else if text.ends_with(" more frames rejected") {
            counts.0 += number();
        } else if text.ends_with(" frames lost: not read before the next one") {
            counts.1 += number();
        }
    }
    counts
}

/// The robot has not moved or restarted, and its log counts every rejected frame.
#[track_caller]
fn assert_unmoved(rig: &Rig, pi: &PiEnd) {
    rig.run_us(2_100_000);
    assert!(rig.truth().path_mm < 0.01, "a bad frame was accepted");
    assert_eq!(rig.resets().len(), 0, "{:?}", rig.resets());
    let log = rig.log();
    // Of a split frame the robot may only come to see the second part.
    let (rejected, lost) = logged_counts(&log);
    assert_eq!(rejected + lost, pi.rejections, "{log}");
    assert!(lost <= pi.count("split"), "{log}");
    rig.assert_modelled();
}

// Requirement: WIRE-spi-2, WIRE-spi-5, WIRE-crc-2
#[test]
fn link_rejects_disturbed_frames_and_accepts_good_ones() {
    let frames = std::env::var(MORE).map_or(FRAMES, |count| count.parse().expect("a number"));
    let rig = guarded();
    let mut pi = PiEnd::new(1);
    while pi.frames < frames {
        let mut disturbances = Vec::new();
        while disturbances.len() < BATCH - 8 {
            let bad = pi.random.below(4);
            let good = 1 + pi.random.below(4);
            disturbances.extend((0..bad).map(|_| Disturbance::bad(&mut pi.random)));
            disturbances.extend((0..good).map(|_| Disturbance::Good));
        }
        pi.exchange(&rig, disturbances);
    }
    println!(
        "{} frames: {:?}; {} acknowledged late, {} spliced replies passed",
        pi.frames, pi.counts, pi.late, pi.spliced
    );
    // Expected is one in 65 536; three times that and two more would be no accident.
    let share = 2 + 3 * pi.count("split") / 65_536;
    assert!(pi.spliced <= share, "{} spliced replies passed", pi.spliced);
    assert_unmoved(&rig, &pi);
}
