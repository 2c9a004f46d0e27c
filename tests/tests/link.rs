//! The guarded link under every disturbance of its signals, through the ELF.
//!
//! Every disturbed frame commands a motion, every good one none: a robot that accepts a disturbed
//! frame moves. The replies report the accepted frames, the log counts the rejected ones.
//!
//! Frames here are 20 µs apart. Where two chip-selects end while the robot is busy with a tick, the older
//! frame may be lost and a reply repeated (docs/interfaces.md); the test allows that there and nowhere else.

use std::collections::BTreeMap;
use std::time::SystemTime;

use fw_core::wire::{Command, FrameError, MAX_FRAME, Mode, Order, PiLink, Reason, Setup};
use robot_tests::disturbance::{Disturbance, LEN, Random, seeds};
use robot_tests::reference::image_in_mode;
use robot_tests::test_board::Rig;
use robot_tests::throughput::{TICK_NS, logged_counts};
use twin::components::spi_master::pack;
use twin::plant::Rng;
use twin::{Options, SpiStep};

/// Environment variable with seeds, `A..B`, each run at every phase; otherwise four seeds that change
/// from day to day, each at one phase, in turn at 60 and 100 MIPS.
const SEEDS: &str = "ROBOT_LINK_SEEDS";
/// Environment variable with their instructions a microsecond, 60 to 100.
const MIPS: &str = "ROBOT_LINK_MIPS";
/// Phases of a run's begin within the tick.
const PHASES: u64 = 8;
/// Frames of a run.
const FRAMES: usize = 20_000;
/// Chip-selects that end this many instructions apart are each read and answered: the longest tick, two
/// frames, and the interrupts meanwhile.
const BUSY_INSTRUCTIONS: u64 = 12_000;
/// A chip-select that rises may go unseen where the frame goes on and ends within this time, nanoseconds.
const UNSEEN_NS: u64 = 3_000;
/// Frames played at a time. The sequence numbers distinguish fresh from old over 127 frames.
const BATCH: usize = 64;
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
    /// [`BUSY_INSTRUCTIONS`] in nanoseconds.
    busy_ns: u64,
    now_ns: u64,
    /// The latest chip-selects, the last one at the end.
    ends: Vec<ChipSelectEnd>,
    /// Chip-selects that ended within [`Self::busy_ns`] of the one before.
    close: usize,
    /// Replies that came once more.
    repeated: usize,
    counts: BTreeMap<&'static str, usize>,
    rejections: usize,
    frames: usize,
    /// Replies that do not acknowledge the frame before theirs yet.
    late: usize,
    /// Replies that were whole because the robot had not seen their chip-select rise.
    unseen: usize,
    /// Replies put together from two that the checksum let through.
    spliced: usize,
}

impl PiEnd {
    fn new(seed: u64, mips: u64) -> Self {
        Self {
            end: PiLink::new(Setup::first_board(Mode::GuardedNormal)),
            seed,
            random: Random(Rng::new(seed)),
            busy_ns: BUSY_INSTRUCTIONS * 1000 / mips,
            now_ns: 0,
            ends: vec![ChipSelectEnd {
                at_ns: 0,
                accepted: vec![0],
            }],
            close: 0,
            repeated: 0,
            counts: BTreeMap::new(),
            rejections: 0,
            frames: 0,
            late: 0,
            spliced: 0,
            unseen: 0,
        }
    }

    /// Puts a frame on the wires.
    fn send(&mut self, disturbance: Disturbance, steps: &mut Vec<SpiStep>) -> Frame {
        let mut command = Command::default();
        if !disturbance.reaches_the_stm_whole() {
            (command.apply, command.order) = (true, Order::Resume);
            command.expected.x = 300_000;
        }
        let mut out = [0; MAX_FRAME];
        let len = self.end.send(&command, &mut out);
        assert_eq!(len, LEN);
        let mut clocks = 0;
        let mut ends_ns = Vec::new();
        for step in disturbance.play(&out[..len], &mut self.random) {
            self.now_ns += step.duration();
            match &step {
                SpiStep::Bits { mosi, .. } => clocks += mosi.len(),
                SpiStep::Select(false) => ends_ns.push(self.now_ns),
                _ => {}
            }
            steps.push(step);
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
        let close = at_ns - last.at_ns <= self.busy_ns;
        self.close += usize::from(close);
        let mut accepted = good.map_or_else(|| last.accepted.clone(), |number| vec![number]);
        if close && good.is_none() {
            // All that ended while the robot may have been busy may have been replaced unread, each by the next.
            let is_busy = |end: &&ChipSelectEnd| at_ns - end.at_ns <= self.busy_ns;
            let unread = self.ends.iter().rev().take_while(is_busy).count();
            let known = self.ends.iter().rev().take(unread + 1);
            accepted.extend(known.flat_map(|end| &end.accepted));
            accepted.sort_unstable();
            accepted.dedup();
        }
        if self.ends.len() > 16 {
            self.ends.remove(0);
        }
        self.ends.push(ChipSelectEnd { at_ns, accepted });
    }

    /// Whether a reply may report `seen`: what the robot knew at the last chip-select's end, at the one
    /// before, or at those that ended while it may have been busy.
    fn may_report(&self, seen: u8) -> bool {
        let ends = self.ends.iter().rev();
        let last = self.ends.last().expect("never empty").at_ns;
        let is_busy = |end: &&ChipSelectEnd| last - end.at_ns <= self.busy_ns;
        let known = ends.clone().take_while(is_busy).count() + 1;
        let mut known = ends.take(known);
        known.any(|end| end.accepted.contains(&seen))
    }

    /// Whether two chip-selects ended while the robot may have been busy, so that a reply is repeated.
    fn may_repeat(&self) -> bool {
        let [before, last] = self.ends.last_chunk().expect("a frame was sent");
        last.at_ns - before.at_ns <= self.busy_ns
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
        // and 1 in 65 536 of those has the right one: counted, and held to that share at the end. Where
        // the frame ends before the robot comes to stop its DMA, the parts are of one reply.
        let ends = &frame.ends_ns;
        let one = ends[ends.len() - 1] - ends[0] < UNSEEN_NS;
        let split = matches!(frame.disturbance, Disturbance::Split(_)) && reply.is_ok();
        let spliced = split && !one;
        self.unseen += usize::from(split && one);
        self.spliced += usize::from(spliced);
        let repeated = matches!(
            reply,
            Err(FrameError { reason: Reason::Stale { last, found }, .. }) if last == found
        ) && self.may_repeat();
        self.repeated += usize::from(repeated);
        assert!(
            repeated || (reply.is_ok() && !split) == frame.disturbance.reaches_the_pi_whole(),
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
        *self.counts.entry(frame.disturbance.name()).or_default() += 1;
    }

    fn count(&self, name: &str) -> usize {
        self.counts.get(name).copied().unwrap_or_default()
    }

    /// Plays frames of these disturbances, 20 µs apart.
    #[track_caller]
    fn exchange(&mut self, rig: &Rig, disturbances: impl IntoIterator<Item = Disturbance>) {
        let mut steps = Vec::new();
        let disturbances = disturbances.into_iter();
        let frames: Vec<_> = disturbances.map(|one| self.send(one, &mut steps)).collect();
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
    let most = rejected + lost + pi.count("split");
    assert!(pi.rejections <= most, "{log}");
    assert!(lost <= pi.close, "{log}");
    // Only a tick keeps the robot busy for that long.
    let ticks = usize::try_from(pi.now_ns / TICK_NS).expect("seconds") + 1;
    let (twice, most) = (pi.repeated + lost, ticks + pi.count("split"));
    assert!(twice <= most, "{twice} in {ticks} ticks");
    rig.assert_modelled();
}

/// Sends disturbed and good frames from `seed`, from a point `phase` of [`PHASES`] in the tick on, to a core
/// of `mips` instructions a microsecond.
fn run(seed: u64, phase: u64, mips: u64) {
    let mut options = Options::with_eeprom(image_in_mode(0x10));
    options.spi_prefetch = [1, 3][(phase % 2) as usize];
    let rig = Rig::with_mips(mips, options);
    rig.run_us(100_000 + phase * TICK_NS / PHASES / 1000);
    let mut pi = PiEnd::new(seed, mips);
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
        "{mips} MIPS seed {seed} phase {phase}: {} frames: {:?}; {} acknowledged late, {} repeated, {} unseen, {} spliced",
        pi.frames, pi.counts, pi.late, pi.repeated, pi.unseen, pi.spliced
    );
    // Expected is one in 65 536; three times that and two more would be no accident.
    let share = 2 + 3 * pi.count("split") / 65_536;
    assert!(pi.spliced <= share, "{} spliced replies passed", pi.spliced);
    assert_unmoved(&rig, &pi);
}

// Requirement: WIRE-spi-2, WIRE-spi-5, WIRE-crc-2
#[test]
fn link_rejects_disturbed_frames_and_accepts_good_ones() {
    if let Some(seeds) = seeds(SEEDS) {
        let mips = std::env::var(MIPS).map_or(60, |mips| mips.parse().expect("a number"));
        for seed in seeds {
            (0..PHASES).for_each(|phase| run(seed, phase, mips));
        }
        return;
    }
    let day = SystemTime::UNIX_EPOCH
        .elapsed()
        .map_or(0, |age| age.as_secs() / 86_400);
    for seed in 4 * day..4 * day + 4 {
        run(seed, seed % PHASES, if seed % 2 == 0 { 60 } else { 100 });
    }
}
