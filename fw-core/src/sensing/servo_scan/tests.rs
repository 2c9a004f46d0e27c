//! The scan tick by tick, on a servo as slow as it allows for; `proofs` samples configurations.

use super::*;
use crate::eeprom::{config_with, fields, first_board};
use crate::sensing::Rangefinders;
use crate::types::Micros;
use crate::types::RangefinderId::Front;
use std::vec::Vec;

fn with_servo() -> Config {
    config_with(&[(fields::SERVO, 1)])
}

/// A servo of 60° in 0.15 s towards its last pulse, degrees; ±90° from 1.0 to 2.0 ms.
struct Servo {
    angle: f64,
    target: f64,
}

impl Servo {
    fn at(angle: f64) -> Self {
        let target = angle;
        Self { angle, target }
    }

    fn turn(&mut self, us: u32) {
        let most = f64::from(us) * 60.0 / 150_000.0;
        self.angle += (self.target - self.angle).clamp(-most, most);
    }

    fn tick(&mut self, pulse: Option<u16>) {
        // A pulse takes effect at its end.
        let width = pulse.map_or(0, u32::from);
        self.turn(width);
        if let Some(pulse) = pulse {
            self.target = (f64::from(pulse) - 1500.0) * 90.0 / 500.0;
        }
        self.turn(10_000 - width);
    }
}

fn degrees(bearing: u16) -> f64 {
    f64::from(bearing.cast_signed()) * 360.0 / 65_536.0
}

/// Tick, bearing and the servo's angle of each trigger, all of which are answered.
fn scanned(config: &Config, ticks: u32, start: f64) -> Vec<(u32, f64, f64)> {
    let mut scan = ServoScan::new(config, true);
    let mut rangefinders = Rangefinders::new(1);
    let mut servo = Servo::at(start);
    let mut all = Vec::new();
    for k in 0..ticks {
        let now = Micros(k * 10_000);
        let pulse = scan.tick(true);
        assert_eq!(pulse.is_some(), k % 2 == 0, "{k}");
        assert!(pulse.is_none_or(|us| (1000..=2000).contains(&us)));
        if rangefinders.tick(now, scan.settled_bearing(), false) == Some(Front) {
            scan.triggered();
            rangefinders.echo(Front, now.after(500), now.after(500 + 1000));
            let bearing = rangefinders.reading(Front).bearing;
            all.push((k, degrees(bearing), servo.angle));
        }
        servo.tick(pulse);
    }
    all
}

// Requirement: WIRE-bearing-4, WIRE-bearing-5
#[test]
fn scan_measures_every_60_ms_in_steps_of_10_degrees() {
    for start in [-90.0, 0.0, 90.0] {
        let all = scanned(&with_servo(), 50 + 6 * 72, start);
        assert_eq!(all.len(), 72);
        assert!(all.windows(2).all(|w| w[1].0 - w[0].0 == 6));
        for (n, &(_, bearing, angle)) in all.iter().enumerate() {
            let step = n as i32 % 36;
            let expected = f64::from(step.min(36 - step)) * 10.0 - 90.0;
            assert!((bearing - expected).abs() < 0.1, "{n} {bearing}");
            assert!((bearing - angle).abs() < 0.01, "{n}: it is at {angle}");
        }
    }
}

// Requirement: WIRE-servo-1, WIRE-servo-2
#[test]
fn pulses_end_without_a_live_link_and_the_position_is_lost() {
    let mut scan = ServoScan::new(&with_servo(), true);
    for live in [false, true, false] {
        for _ in 0..200 {
            let pulse = scan.tick(live);
            assert!(live || pulse.is_none());
            assert!(live || scan.is_off() && scan.settled_bearing().is_none());
            if scan.settled_bearing().is_some() {
                scan.triggered();
            }
        }
    }
    // A pause on the way to the first bearing: the time starts again.
    for _ in 0..30 {
        scan.tick(true);
    }
    assert!(scan.tick(false).is_none() && scan.is_off());
    assert!(scan.tick(true).is_some());
    for k in 1..=FULL_TRAVEL_TICKS {
        scan.tick(true);
        let settled = scan.settled_bearing().is_some();
        assert_eq!(settled, k == FULL_TRAVEL_TICKS, "{k}");
    }
}

// Requirement: WIRE-servo-3
#[test]
fn servo_without_scan_parks_straight_ahead() {
    let mut scan = ServoScan::new(&with_servo(), false);
    assert!(scan.tick(false).is_none() && scan.settled_bearing().is_none());
    let pulses: Vec<u16> = (0..100).filter_map(|_| scan.tick(true)).collect();
    assert_eq!(pulses, [1500; 25]);
    assert_eq!(scan.settled_bearing(), Some(0));
    assert!(scan.tick(false).is_none() && !scan.is_off());
    assert_eq!(scan.settled_bearing(), Some(0));
    let mut fixed = ServoScan::new(&first_board(), false);
    assert_eq!((fixed.tick(true), fixed.settled_bearing()), (None, Some(0)));
}

#[test]
fn late_trigger_keeps_the_settling_and_listening_times() {
    for late in 0..6 {
        let mut scan = ServoScan::new(&with_servo(), true);
        let (mut last_width, mut changed_at, mut settled, mut triggered_at) = (0, 0, 0, 0);
        let mut triggers = 0;
        for k in 0..400_u32 {
            let pulse = scan.tick(true);
            if let Some(width) = pulse.filter(|&width| width != last_width) {
                assert!(triggers == 0 || k - triggered_at >= 2, "{late}: {k}");
                (last_width, changed_at) = (width, k);
            }
            if scan.settled_bearing().is_some() {
                assert!(k - changed_at >= u32::from(STEP_TICKS), "{late}: {k}");
                settled += 1;
            }
            if settled > late {
                (settled, triggered_at) = (0, k);
                triggers += 1;
                scan.triggered();
            }
        }
        assert!(triggers > 25, "{late}: {triggers}");
    }
}

// Requirement: WIRE-sweep-1
#[test]
fn width_beyond_travel_is_cut_to_it() {
    for reversed in [0, 1] {
        for travel in [0x8000, 0x2AAA] {
            let config = config_with(&[
                (fields::SERVO, 1),
                (fields::SERVO_REVERSED, reversed),
                (fields::SERVO_TRAVEL, travel),
            ]);
            let mut scan = ServoScan::new(&config, true);
            scan.set_width(0x7000);
            assert_eq!(u64::from(scan.commanded), travel / 2, "{reversed}");
        }
    }
}

// Requirement: WIRE-sweep-1
#[test]
fn changed_width_counts_from_the_next_step_on() {
    let mut scan = ServoScan::new(&with_servo(), true);
    let (mut servo, mut last) = (Servo::at(0.0), None::<f64>);
    for width in [90.0_f64, 30.0, 60.0, 0.0, 20.0, 75.0, 45.0] {
        scan.set_width((width * 65_536.0 / 360.0) as u16);
        let (mut most, mut bearings) = (0.0_f64, std::collections::BTreeSet::new());
        // To the lower end, which a narrower scan begins above.
        for tick in 0.. {
            if tick > 400 && last.is_some_and(|last| last < 0.2 - width) {
                break;
            }
            let pulse = scan.tick(true);
            if let Some(bearing) = scan.settled_bearing().map(degrees) {
                scan.triggered();
                let off = bearing - servo.angle;
                assert!(off.abs() < 0.2, "{bearing}: off by {off}");
                // One reading may have begun before; the next are beside it.
                if tick >= 12 {
                    most = most.max(bearing.abs());
                    bearings.insert((bearing * 10.0).round() as i32);
                    let beside = last.unwrap_or(bearing).clamp(-width, width);
                    assert!((bearing - beside).abs() < 20.2, "{last:?} {bearing}");
                }
                last = Some(bearing);
            }
            servo.tick(pulse);
        }
        assert!((most - width).abs() < 0.2, "{width}: {most}");
        let steps = (width / 5.0) as usize;
        assert_eq!(bearings.len(), steps + 1, "{width}: {bearings:?}");
    }
}

// Requirement: WIRE-sweep-1
#[test]
fn scan_narrowed_at_either_end_is_within_it_at_once() {
    for end in [-90.0, 90.0] {
        let mut scan = ServoScan::new(&with_servo(), true);
        let (mut narrowed, mut readings) = (false, 0);
        for _ in 0..500 {
            scan.tick(true);
            let Some(bearing) = scan.settled_bearing().map(degrees) else {
                continue;
            };
            scan.triggered();
            if narrowed {
                assert!(bearing.abs() < 30.2, "{end}: {bearing}");
                readings += 1;
            } else if (bearing - end).abs() < 0.2 {
                scan.set_width(0x1555);
                narrowed = true;
            }
        }
        assert!(readings > 20, "{end}: {readings}");
    }
}
