//! Every reply on the wire is one that the core built, byte for byte: the swap of the armed reply under
//! latency.
//!
//! Two frames a tick, the first around the instant at which the tick refreshes the reply, the second 20 µs
//! behind it; the robot drives, so replies differ in every field. In each trial the core stands still for up
//! to 250 cycles at one instruction of the swap: instructions around an access to the transmitting stream.

use std::collections::{BTreeSet, HashSet};

use fw_core::wire::{Command, MAX_FRAME, Mode, PiLink, Setup};
use robot_tests::disturbance::{Random, SETUPS_NS, seeds};
use robot_tests::reference::{KEY_STM, NormalReply, crc16, image_in_mode, normal_frame};
use robot_tests::test_board::{ELF, Rig, TIM5_CCR1, elf, take_writes};
use robot_tests::throughput::{GAP_NS, TICK_NS};
use robot_tests::wires::selected;
use twin::components::spi_master::pack;
use twin::plant::{Pose2, Rng, Room};
use twin::trace::{EventKind, Snapshot, functions};
use twin::{Options, SpiStep};

/// Environment variable with seeds, `A..B`, each run at every phase; otherwise two at every 64th and those near the
/// refresh.
const SEEDS: &str = "ROBOT_SWAP_SEEDS";
/// DMA2's stream 3 (RM0383, 9.5): control, count, memory address.
const S3CR: u64 = 0x4002_6458;
const S3NDTR: u64 = S3CR + 4;
const S3M0AR: u64 = S3CR + 12;
/// The handler of a frame's end clears its line's flag here (RM0383, 10.3.6).
const EXTI_PR: u64 = 0x4001_3C14;
/// Transmit buffers of the firmware, and bytes of each.
const BUFFERS: u64 = 3;
const BUFFER: usize = 32;
/// Time from one commanded pose to the other, nanoseconds.
const STAY_NS: u64 = 3_000_000_000;
/// Begins of the first frame, this far apart, half of them before the refresh, nanoseconds.
const PHASES: usize = 1_200;
const PHASE_NS: u64 = 50;
/// Phases to either side of the refresh that are never left out.
const NEAR: usize = 30;
const CLOCKS: [u64; 2] = [8_000_000, 12_000_000];
/// Longest stall, nanoseconds: 250 cycles, where 100 are demanded.
const STALL_NS: usize = 2_500;

/// The Pi's end of a guarded link.
fn guarded_link() -> PiLink {
    PiLink::new(Setup::first_board(Mode::GuardedNormal))
}

/// The replies that may be on the wire: the armed one, and its refreshes.
#[derive(Default)]
struct Built {
    replies: Vec<Vec<u8>>,
}

impl Built {
    /// A stream that is armed has one reply; at a refresh the fresh one lies complete in one of the buffers.
    fn note(&mut self, snapshot: &Snapshot, base: u64) {
        let buffers = snapshot.bytes.chunks(BUFFER).map(<[u8]>::to_vec);
        if snapshot.written && snapshot.register == S3M0AR {
            let nth = (snapshot.value - base) / BUFFER as u64;
            let nth = usize::try_from(nth).expect("a buffer");
            self.replies = buffers.skip(nth).take(1).collect();
        } else if is_refresh(snapshot) {
            self.replies.extend(buffers);
        }
    }

    fn has(&self, reply: &[u8]) -> bool {
        self.replies.iter().any(|built| built.starts_with(reply))
    }
}

/// The firmware looks how far the transmitter has come: then it refreshes the armed reply, or does not.
fn is_refresh(access: &Snapshot) -> bool {
    access.register == S3NDTR && !access.written
}

fn options(mode: u8, room: Room) -> Options {
    let options = Options::with_eeprom(image_in_mode(mode)).in_room(room);
    options.at(Pose2::default())
}

/// A driving robot, and where its replies lie and are swapped.
struct Drive {
    rig: Rig,
    /// The Pi's end of a guarded link.
    pi: Option<PiLink>,
    /// As far before the lowest transmit buffer that was armed as the others may lie.
    base: u64,
    /// Instructions of the swap, and of them those that refresh a reply.
    swap: Vec<u64>,
    stores: Vec<u64>,
    /// A tick's begin, and how long after it the reply is refreshed, nanoseconds.
    tick_ns: u64,
    refresh_ns: u64,
    built: Built,
}

impl Drive {
    fn new(elf: &[u8], mode: u8, mips: u64, spi_prefetch: u8) -> Self {
        let room = Room::default().with_box(&Pose2::new(1_500.0, 0.0, 0.0), 5_000.0, 2_000.0);
        let mut options = options(mode, room);
        options.mips = mips.try_into().expect("a core that runs");
        options.spi_prefetch = spi_prefetch;
        let rig = Rig::with_elf(elf, options);
        rig.assert_ready();
        let mut drive = Self {
            rig,
            pi: (mode != 0).then(guarded_link),
            base: 0,
            swap: Vec::new(),
            stores: Vec::new(),
            tick_ns: 0,
            refresh_ns: 0,
            built: Built::default(),
        };
        drive.find_swap(elf);
        drive
    }

    /// Drives for two seconds and looks where the firmware uses its transmitting stream.
    fn find_swap(&mut self, elf: &[u8]) {
        self.rig.trace_memory(&[S3CR, S3NDTR, S3M0AR], 0..0);
        self.rig.trace_writes(TIM5_CCR1);
        for _ in 0..200 {
            self.exchange();
        }
        let accesses = self.rig.take_snapshots();
        let is_armed = |access: &&Snapshot| access.written && access.register == S3M0AR;
        let armed = accesses.iter().filter(is_armed).map(|access| access.value);
        self.base = armed.min().expect("armed") - (BUFFERS - 1) * BUFFER as u64;
        let refresh = accesses.iter().rfind(|access| is_refresh(access));
        let refresh = refresh.expect("refreshed");
        let stores = refresh.instruction..refresh.instruction + 60;
        let at: BTreeSet<u64> = accesses.iter().map(|access| access.instruction).collect();
        let near = |address: &u64| at.iter().any(|at| (at - 40..at + 80).contains(address));
        let all = functions(elf).expect("an ELF file").into_iter();
        let all = all.flat_map(|f| f.instructions).map(|one| one.address);
        self.swap = all.filter(near).collect();
        let near_stores = self.swap.iter().copied().filter(|at| stores.contains(at));
        self.stores = near_stores.collect();
        self.tick_ns = take_writes(&self.rig).last().expect("ticks").at_ns;
        self.refresh_ns = (refresh.at_ns - self.tick_ns % TICK_NS) % TICK_NS;
        let end = self.base + (2 * BUFFERS - 1) * BUFFER as u64;
        self.rig.trace_memory(&[S3NDTR, S3M0AR], self.base..end);
        self.exchange();
        for snapshot in self.rig.take_snapshots() {
            self.built.note(&snapshot, self.base);
        }
    }

    /// A frame that commands in turn two poses at both ends of a room.
    fn frame(&mut self, now_ns: u64) -> Vec<u8> {
        let (x, y) = match now_ns / STAY_NS % 2 {
            0 => (2_500_000, 300_000),
            _ => (300_000, -300_000),
        };
        let Some(link) = &mut self.pi else {
            return normal_frame(x, y, 0, true).to_vec();
        };
        let mut command = Command::default();
        let expected = &mut command.expected;
        (command.apply, expected.x, expected.y) = (true, x, y);
        let mut frame = [0; MAX_FRAME];
        let len = link.send(&command, &mut frame);
        frame[..len].to_vec()
    }

    fn exchange(&mut self) {
        let frame = self.frame(self.rig.now_ns());
        let _ = self.rig.frame(&frame);
        self.rig.run_us(10_000);
    }

    /// Two frames around the next refresh, the first from `phase` on. Returns their replies, and whether each
    /// is one that was built.
    fn trial(&mut self, hz: u64, setup_ns: u64, phase: u64) -> [(Vec<u8>, bool); 2] {
        let now = self.rig.now_ns();
        let tick = self.tick_ns + (now - self.tick_ns).div_ceil(TICK_NS) * TICK_NS;
        let begin = tick + self.refresh_ns + phase * PHASE_NS - PHASES as u64 / 2 * PHASE_NS;
        let mut at = now;
        let mut steps = Vec::new();
        let frames = [begin.saturating_sub(now), GAP_NS].map(|wait| {
            let frame = self.frame(now);
            let bits = SpiStep::bytes(&frame, hz);
            at += wait + 2 * setup_ns + bits.duration();
            steps.push(SpiStep::Wait(wait));
            steps.extend(selected(setup_ns, bits));
            (frame.len(), at)
        });
        let miso = pack(&self.rig.spi_steps(steps));
        let snapshots = self.rig.take_snapshots();
        let refresh = snapshots.iter().find(|snapshot| is_refresh(snapshot));
        if let Some(refresh) = refresh.filter(|refresh| refresh.at_ns < begin) {
            self.refresh_ns = (refresh.at_ns - self.tick_ns % TICK_NS) % TICK_NS;
        }
        let mut snapshots = snapshots.iter().peekable();
        let mut replies = miso.chunks(frames[0].0);
        let outcome = frames.map(|(_, ends)| {
            let reply = replies.next().expect("as many as frames").to_vec();
            while let Some(snapshot) = snapshots.next_if(|snapshot| snapshot.at_ns <= ends) {
                self.built.note(snapshot, self.base);
            }
            let built = self.built.has(&reply);
            (reply, built)
        });
        snapshots.for_each(|snapshot| self.built.note(snapshot, self.base));
        outcome
    }
}

/// Drives with two frames a tick at every `nth` phase, each clock and set-up time, the core stalled at a
/// random instruction of the swap. The SPI slave fetches one to three bytes ahead, by the seed.
fn run(mode: u8, mips: u64, seed: u64, nth: usize) {
    let elf = elf(ELF);
    let mut drive = Drive::new(&elf, mode, mips, 1 + (seed % 3) as u8);
    let mut random = Random(Rng::new(seed));
    let mut values: Vec<HashSet<u8>> = Vec::new();
    let (mut frames, mut wrong) = (0, Vec::new());
    for hz in CLOCKS {
        for setup_ns in SETUPS_NS {
            let first = random.below(nth);
            let sampled = |phase: &usize| phase.abs_diff(PHASES / 2) < NEAR || phase % nth == first;
            for phase in (0..PHASES).filter(sampled) {
                let instructions = [&drive.swap, &drive.stores][random.below(2)];
                let address = instructions[random.below(instructions.len())];
                let stall_ns = random.below(STALL_NS + 1) as u64;
                let skip = random.below(4) as u64;
                drive.rig.stall_once(address, skip, stall_ns);
                for (reply, built) in drive.trial(hz, setup_ns, phase as u64) {
                    frames += 1;
                    if !built {
                        wrong.push(format!("{hz} Hz, set-up {setup_ns} ns, phase {phase}, {stall_ns} ns at {address:#x}: {reply:02x?}"));
                    }
                    assert_eq!(reply[0], KEY_STM);
                    values.resize_with(reply.len(), HashSet::new);
                    for (values, byte) in values.iter_mut().zip(reply) {
                        values.insert(byte);
                    }
                }
            }
        }
    }
    let values: Vec<_> = values.iter().map(HashSet::len).collect();
    println!(
        "mode {mode:#x} {mips} MIPS seed {seed}: {frames} frames, {} wrong, values of each byte {values:?}",
        wrong.len()
    );
    wrong.truncate(5);
    assert!(wrong.is_empty(), "of {frames} never built: {wrong:#?}");
    drive.rig.assert_modelled();
}

/// A frame that begins before the gap is over, while the robot still answers the one before, goes on
/// undisturbed.
// Requirement: WIRE-spi-5
#[test]
fn early_frame_gets_a_whole_reply() {
    // The answer is there after 8 µs: time enough to replace the armed reply.
    let rig = Rig::with_mips(100, options(0x10, Room::default()));
    let mut pi = guarded_link();
    let mut next = |steps: &mut Vec<SpiStep>, gap_ns| {
        let mut out = [0; MAX_FRAME];
        let len = pi.send(&Command::default(), &mut out);
        let bits = SpiStep::bytes(&out[..len], 12_000_000);
        steps.extend(selected(60, bits));
        steps.push(SpiStep::Wait(gap_ns));
        len
    };
    for gap_ns in (2_000..6_000).step_by(50) {
        let mut steps = Vec::new();
        let len = next(&mut steps, gap_ns);
        // Late enough that only the first one's answer may come into its way.
        next(&mut steps, 3_300_000);
        let miso = pack(&rig.spi_steps(steps));
        for reply in miso.chunks(len) {
            let (bytes, crc) = reply.split_at(len - 2);
            assert_eq!(crc, crc16(bytes).to_be_bytes(), "{gap_ns}: {reply:02x?}");
        }
    }
}

/// A frame that ends while the answer to the one before is armed waits for that: buffers change hands one after
/// the other.
#[test]
fn frame_end_while_answer_is_armed_waits() {
    let rig = Rig::with_mips(100, options(0x10, Room::default()));
    let all = functions(&elf(ELF)).expect("an ELF file");
    let arm = all.iter().find(|f| f.name.ends_with("spi::arm"));
    // The first time a frame's end arms the standby, the second time its answer is.
    rig.stall_once(arm.expect("not inlined").address, 1, 20_000);
    // No tick refreshes the reply meanwhile.
    rig.run_to_tick();
    rig.run_us(1_000);
    for register in [EXTI_PR, S3M0AR] {
        rig.trace_writes(register);
    }
    let select = SpiStep::Select;
    let bits = SpiStep::bytes(&[0; 26], 12_000_000);
    let mut steps = vec![select(true), SpiStep::Wait(60), bits, select(false)];
    steps.extend([SpiStep::Wait(15_000), select(true), SpiStep::Wait(100)]);
    steps.extend([select(false), SpiStep::Wait(100_000)]);
    rig.spi_steps(steps);
    let writes = take_writes(&rig);
    let first = writes.first_chunk::<4>().expect("four writes");
    let registers = first.map(|write| write.address);
    assert_eq!(registers, [EXTI_PR, S3M0AR, S3M0AR, EXTI_PR]);
}

/// Entering an exception and returning from it takes 22 cycles, 220 ns, on top of the handler's instructions.
#[test]
fn frame_end_is_handled_after_the_exceptions_entry() {
    let rig = Rig::with_mips(100, options(0x10, Room::default()));
    rig.trace_chip_select();
    rig.trace_writes(EXTI_PR);
    let bits = SpiStep::bytes(&[0; 26], 12_000_000);
    let mut steps: Vec<_> = selected(60, bits).into();
    steps.push(SpiStep::Wait(100_000));
    rig.spi_steps(steps);
    let events = rig.take_events();
    let at = |kind: fn(&EventKind) -> bool| events.iter().find(|one| kind(&one.kind));
    let end = at(|kind| *kind == EventKind::ChipSelect(false)).expect("an end");
    let handled = at(|kind| matches!(kind, EventKind::Write { .. })).expect("handled");
    assert!(
        (220..600).contains(&(handled.at_ns - end.at_ns)),
        "{events:?}"
    );
}

/// The transmitter holds a reply's first two bytes ready: a refresh that changes the second, the highest of x,
/// must not be copied over it.
// Requirement: WIRE-spi-6
#[test]
fn reply_refresh_across_zero_keeps_fetched_bytes() {
    let mut options = options(0, Room::default());
    options.spi_prefetch = 3;
    let rig = Rig::ready(options);
    let mut signs = Vec::new();
    for x_um in [150_000, -150_000, 150_000] {
        for _ in 0..400 {
            let reply = NormalReply::of(&rig.frame(&normal_frame(x_um, 0, 0, true)));
            assert!(reply.x.abs() < 200_000, "{reply:?}");
            signs.push(reply.x < 0);
            rig.run_us(10_000);
        }
    }
    signs.dedup();
    assert!(signs.len() >= 3, "x crosses zero both ways: {signs:?}");
}

// Requirement: WIRE-spi-6
#[test]
fn reply_swap_under_latency_sends_whole_replies() {
    let (seeds, nth) = seeds(SEEDS).map_or((1..3, 64), |seeds| (seeds, 1));
    for seed in seeds {
        for mode in [0, 0x10] {
            for mips in [60, 100] {
                run(mode, mips, seed, nth);
            }
        }
    }
}
