use super::*;
use crate::eeprom::first_board;
use fixed::types::{I16F16, I32F32};

fn limit() -> ObstacleLimit {
    ObstacleLimit::new(first_board().obstacle_stop(), true)
}

fn mm(distance: i32) -> Millimetres {
    Millimetres(I32F32::from_num(distance))
}

/// After a tick with this travel, mm, and turn, degrees.
fn moved(limit: &mut ObstacleLimit, travel: f64, turn: f64) -> i32 {
    limit.step(&Delta {
        travel: I16F16::from_num(travel),
        turn: (turn / 360.0 * 4_294_967_296.0) as i32,
        ..Delta::default()
    });
    limit.max_forward()
}

/// After so many readings without an echo.
fn missed(limit: &mut ObstacleLimit, bearing: u16, readings: u32) -> i32 {
    (0..readings).for_each(|_| limit.on_range(bearing, None));
    moved(limit, 0.0, 0.0)
}

/// In µm/s for a distance from the sensor in mm: `−a·t_r + √(a²·t_r² + 2·a·room)`, down to 256 µm/s.
fn expected(distance: f64) -> i32 {
    let room = (distance - 170.0).max(0.0);
    let speed = -40.0 + (1600.0 + 800.0 * room).sqrt();
    (speed * 1000.0 / 256.0 - 1e-9) as i32 * 256
}

const BLIND: i32 = 100_000;

#[test]
fn way_back_is_the_configured_one_less_what_stops() {
    let figures = *first_board().obstacle_stop();
    for mm in [0, 100, 300, 10_000] {
        let figures = ObstacleStop {
            reverse_distance_mm: mm,
            ..figures
        };
        // 50 mm/s, 100 ms, 400 mm/s²: 5 mm and 3.125 mm, each one more.
        let limit = ObstacleLimit::new(&figures, true);
        assert_eq!(limit.reverse_way, Some((i32::from(mm) - 10).max(0) * MM));
        assert_eq!(ObstacleLimit::new(&figures, false).reverse_way, None);
    }
}

#[test]
fn stoppable_is_the_largest_speed_that_stops() {
    for reaction in [0, 1, 313, 78_125, (1 << 17) - 1] {
        let energy = |n: u32| u64::from(n) * u64::from(n + reaction);
        for n in 0..1 << SPEED_BITS {
            let Ok(exact) = u32::try_from(energy(n)) else {
                break;
            };
            assert_eq!(stoppable(reaction, exact), n);
            if n > 0 {
                assert_eq!(stoppable(reaction, exact - 1), n - 1);
            }
        }
    }
}

// Requirement: WIRE-obstacle-1
#[test]
fn echo_allows_what_stops_before_the_stop_distance() {
    for distance in [0, 169, 170, 171, 180, 200, 250, 500, 1000, 2500] {
        let mut limit = limit();
        limit.on_range(0, Some(mm(distance)));
        let found = moved(&mut limit, 0.0, 0.0);
        // The reaction is rounded up by at most a unit.
        let exact = expected(f64::from(distance));
        let is_near = (exact - 512..=exact).contains(&found);
        assert!(is_near, "{distance}: {found} {exact}");
        assert_eq!(limit.limit(found + 1), found);
        assert!(limit.limited(found + 1) && !limit.limited(found));
    }
}

/// Only the way forward counts: the echo is never farther away than it was.
// Requirement: WIRE-obstacle-2
#[test]
fn forward_way_shortens_the_distance() {
    let mut limit = limit();
    limit.on_range(0, Some(mm(500)));
    let mut distance = 500;
    for travel in [100, -50, 30, 200, 9] {
        distance -= travel.max(0);
        let found = moved(&mut limit, travel.into(), 0.0);
        let mut fresh = self::limit();
        fresh.on_range(0, Some(mm(distance)));
        assert_eq!(found, moved(&mut fresh, 0.0, 0.0), "{travel}");
    }
    assert_eq!(limit.max_forward(), 0);
}

// Requirement: WIRE-obstacle-2
#[test]
fn echo_is_void_after_three_misses_or_15_degrees() {
    let mut limit = limit();
    assert_eq!(moved(&mut limit, 0.0, 0.0), BLIND);
    limit.on_range(0, Some(mm(170)));
    assert_eq!(missed(&mut limit, 0, 2), 0);
    limit.on_range(0, Some(mm(170)));
    assert_eq!(missed(&mut limit, 0, 2), 0);
    assert_eq!(missed(&mut limit, 0, 1), BLIND);
    for side in [1.0, -1.0] {
        limit.on_range(0, Some(mm(170)));
        assert_eq!(moved(&mut limit, 0.0, side * 10.0), 0);
        assert_eq!(moved(&mut limit, 0.0, side * 4.99), 0);
        assert_eq!(moved(&mut limit, 0.0, side * -20.0), 0);
        assert_eq!(moved(&mut limit, 0.0, side * -9.98), 0);
        assert_eq!(moved(&mut limit, 0.0, side * -0.02), BLIND);
        // It stays void after turning back.
        assert_eq!(moved(&mut limit, 0.0, side * 15.0), BLIND);
        limit.on_range(0, Some(mm(170)));
        assert_eq!(moved(&mut limit, 0.0, side * 14.0), 0);
    }
}

// Requirement: WIRE-obstacle-2
#[test]
fn reading_beyond_15_degrees_is_ignored() {
    for bearing in [0xAAA_u16, 0x1_0000_u32.wrapping_sub(0xAAA) as u16] {
        let (mut limit, sideways) = (limit(), (bearing as i16 + (bearing as i16).signum()) as u16);
        limit.on_range(sideways, Some(mm(170)));
        assert_eq!(moved(&mut limit, 0.0, 0.0), BLIND);
        limit.on_range(bearing, Some(mm(170)));
        assert_eq!(missed(&mut limit, sideways, 3), 0);
        assert_eq!(missed(&mut limit, bearing, 3), BLIND);
    }
}

// Requirement: WIRE-obstacle-3, WIRE-obstacle-4
#[test]
fn way_back_is_slow_and_short_until_the_next_way_forward() {
    let mut limit = limit();
    // Less 50 mm/s for 100 ms and 50²/800 mm, each rounded up.
    for way in 0..290 {
        let found = (limit.max_reverse(), limit.limit(-60_000));
        assert_eq!(found, (50_000, -50_000), "{way}");
        let _ = moved(&mut limit, -1.0, 0.0);
    }
    assert_eq!((limit.max_reverse(), limit.limit(-1)), (0, 0));
    // A wheel's backlash is no way forward.
    let _ = moved(&mut limit, 9.9, 0.0);
    let _ = moved(&mut limit, -0.1, 0.0);
    let _ = moved(&mut limit, 9.9, 0.0);
    assert_eq!(limit.max_reverse(), 0);
    let _ = moved(&mut limit, 0.1, 0.0);
    assert_eq!(limit.max_reverse(), 50_000);
    let mut to_a_pose = ObstacleLimit::new(first_board().obstacle_stop(), false);
    let _ = moved(&mut to_a_pose, -5000.0, 0.0);
    assert_eq!(to_a_pose.limit(-60_000), -50_000);
}

#[test]
fn limit_with_another_track_goes_on_from_there() {
    let mut before = limit();
    before.on_range(0, Some(mm(170)));
    let _ = moved(&mut before, -200.0, 0.0);
    let mut after = limit().with_track(*before.track());
    assert_eq!(after.track(), before.track());
    assert_eq!(
        moved(&mut after, -90.0, 0.0),
        moved(&mut before, -90.0, 0.0)
    );
    assert_eq!(after.max_reverse(), 0);
}

#[test]
fn ways_longer_than_their_type_stay_at_its_end() {
    let mut ahead = limit();
    ahead.on_range(0, Some(mm(2000)));
    for _ in 0..4 {
        assert_eq!(moved(&mut ahead, 32_000.0, 0.0), 0);
    }
    let mut back = limit();
    for _ in 0..4 {
        let _ = moved(&mut back, -32_000.0, 0.0);
        assert_eq!(back.max_reverse(), 0);
    }
}
