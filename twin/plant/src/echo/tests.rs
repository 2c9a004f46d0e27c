use super::*;

/// The direct or mirrored return in this room for a sensor at the origin with this heading.
fn return_with(world: &Imperfections, room: &str, heading_deg: f64) -> Option<f64> {
    let room = Room::parse(room).unwrap();
    let sonar = Sonar::new(RangefinderParams::exact(), &room, world);
    sonar.nearest_return(&room, &Pose2::new(0.0, 0.0, heading_deg.to_radians()))
}

fn echo(room: &str, heading_deg: f64) -> Option<f64> {
    return_with(&Imperfections::default(), room, heading_deg)
}

/// The default world less an imperfection.
fn without(change: impl FnOnce(&mut Imperfections)) -> Imperfections {
    let mut world = Imperfections::default();
    change(&mut world);
    world
}

/// A wall this far from the sensor.
fn wall(distance_mm: f64) -> String {
    format!("wall {distance_mm} -9000 {distance_mm} 9000")
}

#[test]
fn smooth_wall_answers_up_to_its_incidence() {
    let rough = without(|world| world.incidence = false);
    for distance_mm in [300.0, 1000.0, 2000.0] {
        let wall = wall(distance_mm);
        for degrees in 0..=89 {
            let degrees = f64::from(degrees);
            let answer = echo(&wall, degrees);
            // The nearest point is the foot of the normal, or lies at the cone's rim.
            let nearest = distance_mm / (degrees - 15.0).max(0.0).to_radians().cos();
            let rim = 1.0 - 0.6 * (degrees / 15.0).min(1.0).powi(2);
            let needed = 0.05 + 0.4 * (nearest / 4000.0).powi(2);
            let heard = rim * ((30.0 - degrees) / 10.0).clamp(0.0, 1.0) >= needed;
            assert_eq!(answer.is_some(), heard, "{distance_mm} {degrees}");
            let right = answer.is_none_or(|mm| (mm - nearest).abs() < 0.1);
            assert!(right, "{degrees}");
            assert!(degrees > 20.0 || heard, "{degrees}");
            assert!(degrees < 30.0 || !heard, "{degrees}");
        }
        assert!(return_with(&rough, &wall, 45.0).is_some(), "switched off");
    }
}

#[test]
fn corner_and_edge_answer_where_walls_are_silent() {
    // Into a room's corner at 45° to both walls; the same walls apart are silent.
    let corner = "wall 1000 -5000 1000 1000 -5000 1000";
    let answer = echo(corner, 45.0).unwrap();
    assert!((answer - 1414.2).abs() < 0.1, "{answer}");
    assert_eq!(echo("wall 1000 -5000 1000 5000", 45.0), None);
    // A box's edge points at the sensor: weaker, so from 2.4 m on it is silent.
    let edge = |mm: f64| echo(&format!("box {} 0 400 400 45", mm + 282.84), 0.0);
    assert!((edge(1000.0).unwrap() - 1000.0).abs() < 0.1);
    assert!(edge(2300.0).is_some() && edge(2500.0).is_none());
    // From outside, the angle of two walls is an edge as well.
    let outside = echo("wall 2000 0 4400 2400\nwall 2000 0 4400 -2400", 0.0).unwrap();
    assert!((outside - 2000.0).abs() < 0.1);
    let far = "wall 2600 0 5000 2400\nwall 2600 0 5000 -2400";
    assert_eq!(echo(far, 0.0), None);
    // A wall in two pieces has no edge between them.
    let pieces = "wall 1000 -5000 1000 1000\nwall 1000 1000 1000 5000";
    assert_eq!(echo(pieces, 45.0), None);
}

#[test]
fn leg_and_pillar_answer_by_their_curvature() {
    let round = |mm: f64, radius: f64, heading| {
        echo(&format!("circle {} 0 {radius}", mm + radius), heading)
    };
    assert!((round(500.0, 15.0, 0.0).unwrap() - 500.0).abs() < 1e-6);
    assert!(round(1000.0, 15.0, 0.0).is_some() && round(1800.0, 15.0, 0.0).is_none());
    assert!(round(1800.0, 150.0, 0.0).is_some() && round(3500.0, 150.0, 0.0).is_none());
    assert!(round(300.0, 15.0, 14.0).is_some() && round(1000.0, 15.0, 14.0).is_none());
    assert_eq!(round(300.0, 15.0, 20.0), None);
}

#[test]
fn side_lobe_receives_near_corners_alone() {
    let direct = without(|world| world.double_bounce = false);
    // A corner off the axis, both of its walls at 45° to it and so silent.
    let corner = |mm: f64, aside_deg: f64| {
        let (sin, cos) = aside_deg.to_radians().sin_cos();
        let (x, y) = (mm * cos, mm * sin);
        let (back, low, high) = (x - 3e3, y - 3e3, y + 3e3);
        let walls = format!("wall {back} {low} {x} {y} {back} {high}");
        return_with(&direct, &walls, 0.0)
    };
    assert!((corner(1000.0, 10.0).unwrap() - 1000.0).abs() < 0.1);
    assert!((corner(1000.0, -25.0).unwrap() - 1000.0).abs() < 0.1);
    for (mm, aside) in [(1500.0, 25.0), (1000.0, 20.0), (300.0, 31.0)] {
        assert_eq!(corner(mm, aside), None, "{mm} {aside}");
    }
}

#[test]
fn soft_surface_answers_up_to_one_metre() {
    let curtain = |mm: f64| format!("soft {}", wall(mm));
    assert!(echo(&curtain(990.0), 0.0).is_some());
    assert_eq!(echo(&curtain(1010.0), 0.0), None);
    let hard = without(|world| world.soft_surfaces = false);
    assert!(return_with(&hard, &curtain(1010.0), 0.0).is_some());
    // It hides what is behind it.
    let both = format!("{}\n{}", curtain(1200.0), wall(1300.0));
    assert_eq!(echo(&both, 0.0), None);
}

#[test]
fn double_bounce_reads_mirrored_path() {
    // A wall at 45° mirrors the beam onto another one to the side.
    let mirror = "wall 600 -400 1400 400";
    let room = format!("{mirror}\nwall -500 700 5000 700");
    let answer = echo(&room, 0.0).unwrap();
    assert!((answer - 1700.0).abs() < 15.0, "{answer}");
    let direct = without(|world| world.double_bounce = false);
    assert_eq!(return_with(&direct, &room, 0.0), None);
    assert_eq!(echo(&format!("soft {room}"), 0.0), None);
}

#[test]
fn hidden_surfaces_do_not_answer() {
    let behind = "circle 1500 0 100";
    assert!(echo(behind, 0.0).is_some());
    // An oblique wall in front answers nothing itself, and hides the pillar.
    let hidden = format!("{behind}\nwall 400 -900 1400 900");
    assert_eq!(echo(&hidden, 0.0), None);
}

#[test]
fn echo_near_its_threshold_fades_from_burst_to_burst() {
    let room = Room::parse(&wall(2000.0)).unwrap();
    let sonar = Sonar::new(RangefinderParams::exact(), &room, &Imperfections::default());
    let mut rng = Rng::new(1);
    let mut heard = |degrees: f64| {
        let at = Pose2::new(0.0, 0.0, degrees.to_radians());
        let bursts = (0..200).filter(|_| sonar.measure(&room, &at, &mut rng).is_some());
        bursts.count()
    };
    assert_eq!((heard(18.0), heard(29.0)), (200, 0));
    assert!((40..160).contains(&heard(26.2)));
}
