//! The guarded link under every disturbance of its signals, through the ELF.
//!
//! Every disturbed frame commands a motion, every good one none: a robot that accepts a disturbed
//! frame moves. The replies report the accepted frames, the log counts the rejected ones.
//!
//! Frames here are 20 µs apart. Where two chip-selects end while the robot is busy with a tick, the older
//! frame may be lost and a reply repeated (docs/interfaces.md); the test allows that there and nowhere else.

use std::time::SystemTime;

use fw_core::eeprom::{Config, Image};
use fw_core::wire::{Command, FrameError, Order, PiLink, PoseCode, Reason, MAX_FRAME};
use robot_tests::reference::image_in_mode;
use robot_tests::test_board::Rig;
use twin::components::spi_master::pack;
use twin::plant::Rng;
use twin::SpiStep;

/// Environment variable with seeds, `A..B`, each run at every phase; otherwise three seeds that change
/// from day to day, each at one phase.
const SEEDS: &str = "ROBOT_LINK_SEEDS";
/// Phases of a run's begin within the tick.
const PHASES: u64 = 8;
/// Frames of a run.
const FRAMES: usize = 20_000;
/// Chip-selects that end this far apart are each read and answered, and the tick's period, nanoseconds.
const BUSY_NS: u64 = 100_000;
const TICK_NS: u64 = 10_000_000;
/// Frames played at a time. The sequence numbers distinguish fresh from old over 127 frames.
const BATCH: usize = 64;
/// From a frame's end to the next one's begin, nanoseconds.
const GAP_NS: u64 = 20_000;
/// From the chip select's edge to the clocks, and back, nanoseconds.
const SETUPS_NS: [u64; 4] = [60, 250, 500, 1_000];
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

    /// The bits of a frame that are wrong at a rate; one less where the checksum cannot tell, which is so
    /// for one in some 32 000 patterns of an even number.
    fn wrong_bits(&mut self, of_a_million: u64) -> Vec<usize> {
        let wrong = |_: &usize| (self.below(1_000_000) as u64) < of_a_million;
        let mut bits: Vec<_> = (0..BITS).filter(wrong).collect();
        let remainder = (0..BITS).fold(0_u16, |crc, bit| {
            let shifted = crc << 1 | u16::from(bits.contains(&bit));
            shifted ^ if crc >> 15 == 1 { 0x1021 } else { 0 }
        });
        if remainder == 0 {
            bits.pop();
        }
        bits
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
    /// The ends of its chip-selects.
    ends_ns: Vec<u64>,
}

/// The end of a chip-select, and what the robot may have accepted last by then.
#[derive(Debug)]
struct ChipSelectEnd {
    at_ns: u64,
    accepted: Vec<u8>,
}

/// The Pi's end, and the expected state of the robot's.
struct PiEnd {
    end: PiLink,
    seed: u64,
    random: Random,
    now_ns: u64,
    /// The latest chip-selects, the last one at the end.
    ends: Vec<ChipSelectEnd>,
    /// Chip-selects that ended within [`BUSY_NS`] of the one before.
    close: usize,
    /// Replies that came once more.
    repeated: usize,
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
            seed,
            random: Random(Rng::new(seed)),
            now_ns: 0,
            ends: vec![ChipSelectEnd {
                at_ns: 0,
                accepted: vec![0],
            }],
            close: 0,
            repeated: 0,
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
        let setup_ns = SETUPS_NS[self.random.below(SETUPS_NS.len())];
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
        let mut ends_ns = Vec::new();
        for (mosi, wait) in [(Some(mosi), GAP_NS), (rest, 1_000)] {
            let Some(mosi) = mosi else { continue };
            let bits = mosi.len() as u64;
            self.now_ns += wait;
            self.now_ns += match disturbance {
                Disturbance::Glitch => 200,
                _ => 2 * setup_ns + bits * 1_000_000_000 / hz,
            };
            ends_ns.push(self.now_ns);
            steps.extend([SpiStep::Wait(wait), SpiStep::Select(true)]);
            if disturbance == Disturbance::Glitch {
                steps.push(SpiStep::Wait(200));
            } else {
                steps.push(SpiStep::Wait(setup_ns));
                steps.push(SpiStep::Bits { mosi, hz });
                steps.push(SpiStep::Wait(setup_ns));
            }
            steps.push(SpiStep::Select(false));
        }
        Frame {
            number: out[1],
            disturbance,
            clocks,
            ends_ns,
        }
    }

    /// Notes the end of a chip-select; `good` is the sequence number of a frame that arrived whole.
    fn note_end(&mut self, at_ns: u64, good: Option<u8>) {
        let last = self.ends.last().expect("never empty");
        let close = at_ns - last.at_ns <= BUSY_NS;
        self.close += usize::from(close);
        let mut accepted = good.map_or_else(|| last.accepted.clone(), |number| vec![number]);
        if close && good.is_none() {
            // The frame before may have been replaced unread.
            if let Some(before) = self.ends.iter().rev().nth(1) {
                accepted.extend(&before.accepted);
                accepted.sort_unstable();
                accepted.dedup();
            }
        }
        if self.ends.len() > 16 {
            self.ends.remove(0);
        }
        self.ends.push(ChipSelectEnd { at_ns, accepted });
    }

    /// Whether a reply may report `seen`: what the robot knew at the last chip-select's end, at the one
    /// before, or at those that ended while it may have been busy.
    fn may_report(&self, seen: u8) -> bool {
        let mut ends = self.ends.iter().rev();
        let last = self.ends.last().expect("never empty").at_ns;
        let busy = ends.clone().take_while(|end| last - end.at_ns <= BUSY_NS);
        let known = busy.count() + 1;
        ends.by_ref()
            .take(known)
            .any(|end| end.accepted.contains(&seen))
    }

    /// Whether two chip-selects ended while the robot may have been busy, so that a reply is repeated.
    fn may_repeat(&self) -> bool {
        let [before, last] = self.ends.last_chunk().expect("a frame was sent");
        last.at_ns - before.at_ns <= BUSY_NS
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
        let repeated = matches!(
            reply,
            Err(FrameError { reason: Reason::Stale { last, found }, .. }) if last == found
        ) && self.may_repeat();
        self.repeated += usize::from(repeated);
        assert!(
            repeated || (reply.is_ok() && !spliced) == frame.disturbance.reaches_the_pi_whole(),
            "seed {} frame {} {:?}: {reply:?}",
            self.seed,
            self.frames,
            frame.disturbance
        );
        if let Ok(report) = reply {
            let seen = report.sequence.seen;
            self.late += usize::from(!self.ends[self.ends.len() - 1].accepted.contains(&seen));
            assert!(
                self.may_report(seen),
                "seed {} frame {}: the robot reports {seen} accepted after {:?}",
                self.seed,
                self.frames,
                self.ends
            );
        }
        let whole = frame.disturbance.reaches_the_stm_whole();
        for &at_ns in &frame.ends_ns {
            self.note_end(at_ns, whole.then_some(frame.number));
        }
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
        for frame in &frames {
            let (own, others) = rest.split_at(frame.clocks);
            rest = others;
            self.check_reply(frame, own);
        }
        rig.run_us(100);
        self.now_ns += 100_000;
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
    let (rejected, lost) = logged_counts(&log);
    // Lost frames may be good ones; of a split frame the robot may only come to see the second part.
    assert!(rejected <= pi.rejections, "{log}");
    assert!(
        pi.rejections <= rejected + lost + pi.count("split"),
        "{log}"
    );
    assert!(lost <= pi.close, "{log}");
    // Only a tick keeps the robot busy for that long.
    let ticks = usize::try_from(pi.now_ns / TICK_NS).expect("seconds") + 1;
    assert!(
        pi.repeated + lost <= ticks + pi.count("split"),
        "{} repeated, {lost} lost in {ticks} ticks",
        pi.repeated
    );
    rig.assert_modelled();
}

/// Sends disturbed and good frames from `seed`, from a point `phase` of [`PHASES`] in the tick on.
fn run(seed: u64, phase: u64) {
    let rig = guarded();
    rig.run_us(phase * TICK_NS / PHASES / 1000);
    let mut pi = PiEnd::new(seed);
    while pi.frames < FRAMES {
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
        "seed {seed} phase {phase}: {} frames: {:?}; {} acknowledged late, {} repeated, {} spliced replies",
        pi.frames, pi.counts, pi.late, pi.repeated, pi.spliced
    );
    // Expected is one in 65 536; three times that and two more would be no accident.
    let share = 2 + 3 * pi.count("split") / 65_536;
    assert!(pi.spliced <= share, "{} spliced replies passed", pi.spliced);
    assert_unmoved(&rig, &pi);
}

// Requirement: WIRE-spi-2, WIRE-spi-5, WIRE-crc-2
#[test]
fn link_rejects_disturbed_frames_and_accepts_good_ones() {
    if let Ok(seeds) = std::env::var(SEEDS) {
        let bound = |text: &str| text.parse::<u64>().expect("ROBOT_LINK_SEEDS=A..B");
        let (first, end) = seeds.split_once("..").expect("ROBOT_LINK_SEEDS=A..B");
        let runs = (bound(first)..bound(end)).flat_map(|seed| (0..PHASES).map(move |p| (seed, p)));
        return runs.for_each(|(seed, phase)| run(seed, phase));
    }
    let day = SystemTime::UNIX_EPOCH
        .elapsed()
        .map_or(0, |age| age.as_secs() / 86_400);
    for seed in 3 * day..3 * day + 3 {
        run(seed, seed % PHASES);
    }
}
