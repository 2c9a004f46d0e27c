//! T9, every order of echoes, frames and faults: the core's own robot with its rangefinders, their servo and its
//! supervisor, from the edges of an echo to the distance on the wire and the line in the log.
//!
//! Domain: a standing robot that ticks every 10 ms. Each trigger ends in one of the ways of [`FATES`]; before each
//! tick a frame, a fault or nothing comes. A state is what must be true and the robot's supervisor, rangefinders
//! and servo: what is searched reads nothing else but what the lines so far tell. Times are relative to now, and
//! what only counts up to a bound or for the log is cut there.

mod common;

use common::{ByText, with_numbers};
use fw_core::eeprom::{Config, fields};
use fw_core::log::Log;
use fw_core::robot::{ReceivedFrame, Robot, TickInput, TickOutput};
use fw_core::types::{Faults, Micros, RangefinderId};
use fw_core::wire::{Command, MAX_FRAME, Mode, PiLink};
use proofs::eeprom::accepted::AcceptedConfig;
use proofs::search::{Model, assert_broken, assert_holds};

const TICK: u32 = 10_000;
/// Of the servo, 1/65536 turns: two steps of 10°. What it turns in a tick, 60° in 0.15 s, and in half a turn, µs.
const TRAVEL: i32 = 3640;
const SPEED: i32 = 200;
const HALF_TURN: i32 = 9_000;
/// Ticks in which it may be anywhere once there are pulses.
const HOMING: u8 = 50;
/// Ticks beyond which nothing depends on them.
const LONG: u8 = 12;
/// No distance.
const NONE: u16 = 0xFFFF;

/// How the line of a triggered sensor moves: µs to the rise and to the fall; its code, or none for a miss.
type Fate = (u32, u32, Option<u16>);

/// `None` never rises. The first few are those of a sensor on a servo.
const FEW: usize = 4;
const FATES: [Option<Fate>; 8] = [
    None,
    // 171.5 mm; the part's own time-out.
    Some((500, 1_500, Some(4496))),
    Some((500, 38_500, Some(NONE))),
    // Falls after the next trigger, or else is beyond the range.
    Some((500, 65_500, Some(NONE))),
    // 2486.75 mm, and just beyond the range.
    Some((2_900, 17_400, Some(65_188))),
    Some((500, 25_500, Some(NONE))),
    // Shorter than any object's; rises too late to be this trigger's.
    Some((500, 600, None)),
    Some((3_500, 4_500, None)),
];

/// What comes before a tick: a frame with half the width of the scan, a fault that blocks or its end.
#[derive(Clone, Copy, Debug)]
enum Word {
    Nothing,
    Frame(u16),
    Fault,
}

/// A robot, its parts and its caller.
#[derive(Clone, Copy, Debug)]
struct Ranging {
    mode: Mode,
    sensors: u8,
    servo: bool,
    words: &'static [Word],
    fates: usize,
    /// Ticks since the trigger of the oldest distance on the wire.
    oldest: u8,
    /// Broken on purpose: other than 1 tick in 10 ms, other than [`SPEED`], or edges of an earlier trigger are
    /// stamped as the last one's.
    ticks: u8,
    speed: i32,
    restamps: bool,
}

/// A sensor, as it must be.
#[derive(Clone, Copy, Debug, Default)]
struct Sensor {
    /// Ticks since its last trigger.
    since: u8,
    /// Bearing of the trigger that has not ended.
    open: Option<u16>,
    /// How its line will move, and the ticks since that trigger.
    line: Option<(Fate, u8)>,
    /// Code and bearing on the wire, ticks since the trigger of a distance.
    shown: (Option<u16>, u16),
    age: u8,
    misses: u8,
}

impl Sensor {
    fn end(&mut self, code: Option<u16>) {
        let distance = code.filter(|&code| code != NONE);
        self.shown = (distance, self.open.take().unwrap_or_default());
        self.age = self.since;
        self.misses = code.map_or((self.misses + 1).min(3), |_| 0);
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Facts {
    sensors: [Sensor; 3],
    /// Sensor triggered in the last tick.
    triggered: Option<usize>,
    /// Ticks for which the last frame counts.
    fresh: u8,
    faulted: bool,
    /// Ticks with pulses; the width of the last one, and whether it was in the last tick; where the servo is.
    homing: u8,
    pulse: Option<i32>,
    pulsed: bool,
    at: i32,
}

#[derive(Clone)]
struct Value {
    robot: Robot,
    pi: PiLink,
    now: Micros,
    facts: Facts,
}

/// A state and its text.
fn known(value: Value) -> ByText<Value> {
    let all = format!("{:?}", value.robot);
    let part = |from: &str, to: &str| {
        let rest = all.split_once(from).map(|(_, rest)| rest);
        rest.and_then(|rest| rest.split_once(to)).expect("a part").0
    };
    // Once the deadline has expired its time is not read again.
    let supervisor = part(" supervisor: ", ", odometry: ").split("expired: true");
    let parts = supervisor.last().unwrap_or_default().to_owned()
        + part(" rangefinders: ", ", thermometer: ");
    let parts = with_numbers(&parts, |name, number| match name {
        "hits: " | "out_of_range: " | "missing: " => 0,
        "consecutive_misses: " => number.min(3),
        "ticks: " => number.min(LONG.into()),
        "Micros(" => value.now.since(Micros(number)).min(120_000),
        _ => number,
    });
    let text = format!("{:?} {parts}", value.facts);
    ByText { value, text }
}

impl Ranging {
    fn config(&self) -> Config {
        let values = AcceptedConfig::FIRST_BOARD
            .with(fields::MODE, self.mode.code().into())
            .with(fields::RANGEFINDERS, self.sensors.into())
            .with(fields::SERVO, self.servo.into())
            .with(fields::SERVO_TRAVEL, TRAVEL.unsigned_abs().into())
            .with(fields::STOP_DEADLINE, 25)
            .with(fields::BATTERY_CUTOFF, 0);
        values.config().expect("it is accepted")
    }

    /// The edges of the last 10 ms reach the robot.
    fn echoes(&self, next: &mut Value) {
        let now = next.now.0;
        let ago = |ticks: u8| Micros(now.wrapping_sub(u32::from(ticks) * TICK));
        for (id, sensor) in RangefinderId::ALL.into_iter().zip(&mut next.facts.sensors) {
            let Some((fate, ticks)) = sensor.line.take() else {
                continue;
            };
            let ((rise, fall, code), trigger) = (fate, ago(ticks + 1));
            if fall >= now.wrapping_sub(trigger.0) {
                sensor.line = Some((fate, ticks + 1));
                continue;
            }
            let own = ticks == sensor.since;
            let restamped = self.restamps && !own;
            let began = ago(if restamped { sensor.since } else { ticks } + 1);
            (next.robot).on_echo(id, began.after(rise), trigger.after(fall));
            if sensor.open.is_some() && own && rise <= 3_000 {
                sensor.end(code);
            }
        }
    }

    /// A frame ends, or a fault is found.
    fn word(next: &mut Value, word: Word, log: &mut Log) {
        let facts = &mut next.facts;
        facts.fresh = facts.fresh.saturating_sub(1);
        let mut command = Command::default();
        match word {
            Word::Nothing => return,
            Word::Frame(width) => command.sweep = width,
            Word::Fault if facts.faulted => command.clear_faults = Faults::ALL_BITS,
            Word::Fault => {
                facts.faulted = true;
                return next.robot.raise(Faults::SUPPLY_LOW, log);
            }
        }
        // It ended 5 ms ago, the deadline is 25 ms.
        facts.fresh = 2;
        facts.faulted &= command.clear_faults.is_empty();
        let mut bytes = [0; MAX_FRAME];
        let len = next.pi.send(&command, &mut bytes);
        let frame = ReceivedFrame {
            bytes: &bytes[..len],
            overflow_len: 0,
            at: Micros(next.now.0.wrapping_sub(TICK / 2)),
            reply: 1,
        };
        let command = next.robot.receive(&frame).expect("it is fresh");
        next.robot.execute(&command, frame.at, log);
    }

    /// The servo, by the rules.
    fn servo(&self, facts: &mut Facts, width: Option<u16>) -> Result<(), String> {
        let parks = self.mode == Mode::Normal;
        let fitted = self.servo && !(parks && facts.homing > HOMING);
        let live = facts.fresh > 0 && !facts.faulted;
        if fitted && live {
            facts.homing = (facts.homing + 1).min(HOMING + 1);
        } else if fitted {
            (facts.homing, facts.pulse, facts.pulsed) = (0, None, false);
            for sensor in &mut facts.sensors {
                (sensor.open, sensor.shown) = (None, (None, 0));
            }
        }
        let parked = parks && facts.homing > HOMING;
        if width.is_some() != (fitted && live && !parked && !facts.pulsed) {
            return Err(format!("{width:?} as the servo's pulse"));
        }
        facts.pulsed = width.is_some();
        let way = facts.pulse.map_or(0, |before| before - facts.at);
        facts.at += way.clamp(-self.speed, self.speed);
        if let Some(width) = width.map(i32::from) {
            facts.at = facts.pulse.map_or(width - HALF_TURN, |_| facts.at);
            facts.pulse = Some(width);
        }
        Ok(())
    }

    /// The trigger, by the rules.
    fn trigger(&self, facts: &mut Facts, which: usize) -> Result<(), String> {
        let busy = |other: &Sensor| other.since < 2 + u8::from(other.open.is_some());
        if facts.sensors[which].since < 6 || facts.sensors.iter().any(busy) {
            return Err("a trigger while an echo may be on its way".into());
        }
        let turns = which == 0 && self.mode != Mode::Normal;
        let settled = facts.homing > HOMING && (!turns || facts.pulse == Some(facts.at));
        if self.servo && !settled {
            return Err("a trigger before the servo is at its place".into());
        }
        let bearing = i32::from(turns) * (facts.at - 1500) * TRAVEL / 1000;
        facts.triggered = Some(which);
        let sensor = &mut facts.sensors[which];
        if sensor.open.is_some() {
            sensor.end(None);
        }
        sensor.open = u16::try_from(bearing.rem_euclid(1 << 16)).ok();
        sensor.since = 0;
        Ok(())
    }

    /// What the Pi and the log see after a tick.
    fn compare(&self, before: &Facts, next: &Value, log: &Log) -> Result<(), String> {
        let (mut robot, mut bytes) = (next.robot.clone(), [0; MAX_FRAME]);
        let len = robot.encode_reply(1, &mut bytes);
        let mut pi = PiLink::new(self.config().link_setup());
        let report = pi.receive(&bytes[..len]).expect("it is right");
        let lines = String::from_utf8_lossy(log.pending());
        for at in 0..usize::from(self.sensors) {
            let sensor = &next.facts.sensors[at];
            let distance = Some(report.ranges[at].0).filter(|&code| code != NONE);
            let seen = (distance, u16::from(at == 0) * report.bearing);
            if seen != sensor.shown {
                return Err(format!("{seen:?} in place of {:?}", sensor.shown));
            }
            if distance.is_some() && sensor.age > self.oldest {
                return Err(format!("a distance of {} ticks ago", sensor.age));
            }
            let [was, is] = [before.sensors[at].misses, sensor.misses].map(|misses| misses >= 3);
            let about = format!("{} rangefinder ", RangefinderId::ALL[at].name());
            let word = about.clone() + if is { "silent" } else { "answers" };
            let logged = [about, word].map(|text| lines.matches(&text).count());
            if logged != [usize::from(was != is); 2] {
                return Err(format!("after {} misses: {lines}", sensor.misses));
            }
        }
        Ok(())
    }
}

impl Model for Ranging {
    type State = ByText<Value>;
    type Event = (Word, Option<Fate>);

    fn starts(&self) -> Vec<Self::State> {
        let config = self.config();
        let mut facts = Facts::default();
        for sensor in &mut facts.sensors {
            sensor.since = LONG;
        }
        vec![known(Value {
            robot: Robot::new(&config, TickInput::default()),
            pi: PiLink::new(config.link_setup()),
            // It wraps within the run.
            now: Micros(u32::MAX - 25 * TICK),
            facts,
        })]
    }

    fn events(&self, state: &Self::State) -> Vec<Self::Event> {
        let facts = &state.value.facts;
        // A line that is still high takes no trigger.
        let free = |&which: &usize| facts.sensors[which].line.is_none();
        let fates = facts.triggered.filter(free).map_or(1, |_| self.fates);
        let with = |&word: &Word| FATES[..fates].iter().map(move |&fate| (word, fate));
        self.words.iter().flat_map(with).collect()
    }

    fn step(&self, state: &Self::State, event: &Self::Event) -> Result<Self::State, String> {
        let (mut next, mut log) = (state.value.clone(), Log::new());
        if let (Some(which), Some(fate)) = (next.facts.triggered.take(), event.1) {
            next.facts.sensors[which].line = Some((fate, 0));
        }
        next.now = next.now.after(TICK);
        self.echoes(&mut next);
        Self::word(&mut next, event.0, &mut log);
        let input = TickInput {
            now: next.now,
            ..TickInput::default()
        };
        let mut output = TickOutput::default();
        for _ in 0..self.ticks {
            output = next.robot.on_tick(input, &[], &mut log);
        }
        for sensor in &mut next.facts.sensors {
            sensor.since = (sensor.since + 1).min(LONG);
            sensor.age = u8::from(sensor.shown.0.is_some()) * (sensor.age + 1);
            if let (2, Some(bearing)) = (sensor.since, sensor.open) {
                sensor.shown = (None, bearing);
            }
        }
        self.servo(&mut next.facts, output.servo)?;
        if let Some(which) = output.trigger {
            self.trigger(&mut next.facts, which as usize)?;
        }
        self.compare(&state.value.facts, &next, &log)?;
        Ok(known(next))
    }
}

const FIXED: Ranging = Ranging {
    mode: Mode::Normal,
    sensors: 2,
    servo: false,
    words: &[Word::Nothing],
    fates: FATES.len(),
    oldest: 8,
    ticks: 1,
    speed: SPEED,
    restamps: false,
};
const SWEPT: Ranging = Ranging {
    mode: Mode::GuardedSweep,
    sensors: 1,
    servo: true,
    words: &[Word::Nothing, Word::Frame(0), Word::Fault],
    fates: FEW,
    ..FIXED
};

// Requirement: WIRE-distance-1, WIRE-log-9
#[test]
fn fixed_rangefinders_hold_in_every_order() {
    assert_holds(&FIXED, 2_000);
    let mut three = FIXED;
    (three.sensors, three.fates, three.oldest) = (3, FEW, 11);
    assert_holds(&three, 7_000);
}

// Requirement: WIRE-servo-1, WIRE-servo-2, WIRE-servo-3, WIRE-bearing-2, WIRE-sweep-1
#[test]
fn rangefinder_on_a_servo_holds_in_every_order() {
    assert_holds(&SWEPT, 18_000);
    let mut other = SWEPT;
    (other.mode, other.words) = (Mode::Normal, &SWEPT.words[..2]);
    assert_holds(&other, 700);
    other.words = &[Word::Frame(0), Word::Frame(1820)];
    (other.mode, other.sensors, other.fates) = (Mode::GuardedVelocity, 2, 2);
    // It turns by 10° more where the width changes.
    other.oldest = 10;
    assert_holds(&other, 3_500);
}

#[test]
fn broken_board_is_found() {
    let [mut hasty, mut restamps, mut slow] = [FIXED, FIXED, SWEPT];
    (hasty.ticks, restamps.restamps, slow.speed) = (2, true, SPEED / 2);
    assert_broken(&[
        (hasty, "may be on its way"),
        (restamps, "in place of (None"),
        (slow, "at its place"),
    ]);
}
