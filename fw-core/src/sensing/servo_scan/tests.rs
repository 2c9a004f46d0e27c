//! The servo's plan, tick by tick, and what a servo as slow as it allows for makes of it.

extern crate std;

use super::*;
use crate::sensing::{Echo, Rangefinders};
use crate::types::Micros;
use crate::types::RangefinderId::Front;
use std::vec::Vec;

fn platform() -> Platform {
    Platform {
        servo: true,
        ..Platform::FIRST_BOARD
    }
}

/// A servo of 60° in 0.15 s that follows its last pulse, degrees; ±90° from 1.0 to 2.0 ms.
struct Servo {
    at: f64,
    told: f64,
}

impl Servo {
    fn pass(&mut self, us: u32) {
        let way = f64::from(us) * 60.0 / 150_000.0;
        self.at += (self.told - self.at).clamp(-way, way);
    }

    fn tick(&mut self, pulse: Option<u16>) {
        // It learns what a pulse says when the pulse is over.
        let width = pulse.map_or(0, u32::from);
        self.pass(width);
        if let Some(pulse) = pulse {
            self.told = (f64::from(pulse) - 1500.0) * 90.0 / 500.0;
        }
        self.pass(10_000 - width);
    }
}

fn degrees(bearing: u16) -> f64 {
    f64::from(bearing.cast_signed()) * 360.0 / 65_536.0
}

/// Runs for `ticks` with an echo for every trigger: tick, bearing and the servo's true angle of each.
fn swept(platform: &Platform, ticks: u32, stands_at: f64) -> Vec<(u32, u16, f64)> {
    let mut sweep = ServoScan::new(platform, true);
    let mut rangefinders = Rangefinders::new(1);
    let mut servo = Servo {
        at: stands_at,
        told: stands_at,
    };
    let mut all = Vec::new();
    for k in 0..ticks {
        let now = Micros(k * 10_000);
        let pulse = sweep.tick(true);
        if rangefinders.tick(now, sweep.settled_bearing()) == Some(Front) {
            sweep.triggered();
            rangefinders.echo(Front, now.after(500), now.after(500 + 1000));
            assert!(matches!(
                rangefinders.reading(Front).echo,
                Echo::Distance(_)
            ));
            all.push((k, rangefinders.reading(Front).bearing, servo.at));
        }
        servo.tick(pulse);
    }
    all
}

// Requirement: WIRE-bearing-4, WIRE-bearing-5
#[test]
fn it_measures_every_60_ms_from_end_to_end_and_back_in_steps_of_10_degrees() {
    let all = swept(&platform(), 50 + 6 * 72, 90.0);
    assert_eq!(all.len(), 72);
    assert!(all.windows(2).all(|w| w[1].0 - w[0].0 == 6));
    for (n, &(_, bearing, _)) in all.iter().enumerate() {
        let step = n % 36;
        let expected = if step <= 18 {
            step * 10
        } else {
            (36 - step) * 10
        };
        let expected = f64::from(u32::try_from(expected).unwrap()) - 90.0;
        assert!(
            (degrees(bearing) - expected).abs() < 0.1,
            "{n} {bearing:#x}"
        );
    }
}

#[test]
fn the_servo_stands_where_the_reading_says_from_wherever_it_began() {
    for stands_at in [-90.0, 0.0, 90.0] {
        for (_, bearing, truth) in swept(&platform(), 500, stands_at) {
            assert!(
                (degrees(bearing) - truth).abs() < 0.01,
                "{bearing:#x} {truth}"
            );
        }
    }
}

#[test]
fn travel_direction_and_mount_are_the_configurations() {
    let narrow = Platform {
        servo_travel: 0x4000,
        servo_reversed: true,
        bearings: [0x2000, 0, 0],
        ..platform()
    };
    let all: Vec<f64> = swept(&narrow, 50 + 6 * 10, 0.0)
        .iter()
        .map(|look| degrees(look.1))
        .collect();
    assert_eq!(all.len(), 10);
    assert!((all[0] - 90.0).abs() < 0.1 && all[9].abs() < 0.1, "{all:?}");
    assert!(all.windows(2).all(|w| (w[0] - w[1] - 10.0).abs() < 0.2));
}

#[test]
fn pulses_are_20_ms_apart_and_1_to_2_ms_long() {
    let mut sweep = ServoScan::new(&platform(), true);
    for k in 0..1000 {
        let pulse = sweep.tick(true);
        if sweep.settled_bearing().is_some() {
            sweep.triggered();
        }
        assert_eq!(pulse.is_some(), k % 2 == 0, "{k}");
        assert!(pulse.is_none_or(|us| (1000..=2000).contains(&us)));
    }
}

// Requirement: WIRE-servo-1, WIRE-servo-2
#[test]
fn nothing_turns_before_somebody_talks_to_it_nor_after() {
    let mut sweep = ServoScan::new(&platform(), true);
    for live in [false, true, false] {
        for _ in 0..200 {
            let pulse = sweep.tick(live);
            assert!(live || pulse.is_none());
            assert!(live || sweep.is_off() && sweep.settled_bearing().is_none());
            if sweep.settled_bearing().is_some() {
                sweep.triggered();
            }
        }
    }
    // It may stand anywhere now.
    assert!(sweep.tick(true).is_some());
    for k in 1..=u32::from(ANYWHERE) {
        sweep.tick(true);
        assert_eq!(
            sweep.settled_bearing().is_some(),
            k == u32::from(ANYWHERE),
            "{k}"
        );
    }
}

// Requirement: WIRE-servo-3
#[test]
fn in_any_other_mode_it_turns_straight_ahead_once_and_rests() {
    let mut sweep = ServoScan::new(&platform(), false);
    assert!(sweep.tick(false).is_none() && sweep.settled_bearing().is_none());
    let pulses: Vec<u16> = (0..100).filter_map(|_| sweep.tick(true)).collect();
    assert_eq!(pulses, [1500; 25]);
    assert_eq!(sweep.settled_bearing(), Some(0));
    assert!(sweep.tick(false).is_none() && !sweep.is_off());
    assert_eq!(sweep.settled_bearing(), Some(0), "and stays there");
}

#[test]
fn without_a_servo_it_always_points_ahead() {
    let mut sweep = ServoScan::new(&Platform::FIRST_BOARD, false);
    assert_eq!((sweep.tick(true), sweep.settled_bearing()), (None, Some(0)));
}

#[test]
fn however_late_a_trigger_comes_the_servo_has_its_time_before_and_the_echo_after_it() {
    for late in 0..6 {
        let mut sweep = ServoScan::new(&platform(), true);
        let (mut told, mut told_at, mut stood, mut triggered_at) = (0, 0, 0, 0);
        let mut looks = 0;
        for k in 0..400_u32 {
            let pulse: Option<u16> = sweep.tick(true);
            if let Some(width) = pulse.filter(|&width| width != told) {
                // The sensor has listened for 20 ms to where it was turned.
                assert!(looks == 0 || k - triggered_at >= 2, "{late}: {k}");
                (told, told_at) = (width, k);
            }
            if sweep.settled_bearing().is_some() {
                // From the beginning of its first pulse at a bearing, 40 ms, as its plan says.
                assert!(k - told_at >= u32::from(STEP), "{late}: {k}");
                stood += 1;
            }
            if stood > late {
                (stood, triggered_at) = (0, k);
                looks += 1;
                sweep.triggered();
            }
        }
        assert!(looks > 25, "{late}: {looks}");
    }
}
