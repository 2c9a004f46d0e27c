use super::*;

const SEEDS: u32 = 1000;

fn only(change: impl FnOnce(&mut Imperfections)) -> Imperfections {
    let mut world = Imperfections::none();
    change(&mut world);
    world
}

/// What both wheels roll on this floor in `steps` of a metre.
fn metre(world: &Imperfections, seed: u32, steps: u32) -> Sides<f64> {
    let mut floor = Floor::new(world, seed.into());
    let mm = 1000.0 / f64::from(steps);
    (0..steps).fold(Sides::default(), |sum: Sides<f64>, _| {
        let rolled = floor.travel(Sides::new(mm, mm));
        sum.zip(rolled).map(|(sum, mm)| sum + mm)
    })
}

#[test]
fn travel_noise_is_white_and_independent_per_wheel() {
    let noisy = only(|world| world.travel_noise_mm = Imperfections::default().travel_noise_mm);
    for steps in [1, 100] {
        let rolls: Vec<Sides<f64>> = (0..SEEDS).map(|seed| metre(&noisy, seed, steps)).collect();
        let rms = |of: fn(&Sides<f64>) -> f64| {
            (rolls.iter().map(|r| of(r).powi(2)).sum::<f64>() / f64::from(SEEDS)).sqrt()
        };
        // 0.15 mm · √10, and twice the variance in the difference: 0.3° of yaw.
        let (left, right) = (rms(|r| r.left - 1000.0), rms(|r| r.right - 1000.0));
        let yaw_deg = rms(|r| (r.right - r.left) / 125.0).to_degrees();
        for wheel in [left, right] {
            assert!((wheel - 0.474).abs() < 0.03, "{wheel}");
        }
        assert!((yaw_deg - 0.307).abs() < 0.02, "{yaw_deg}");
    }
    let ideal = metre(&Imperfections::none(), 1, 1);
    assert_eq!(ideal, Sides::new(1000.0, 1000.0));
}

/// The pose after driving 600 mm along x, or back, in steps of a millimetre over sills at x = 100 mm
/// and at y = 50 mm.
fn over_sills(world: &Imperfections, seed: u32, backwards: bool) -> Pose2 {
    let room = Room::parse("sill 100 -50 100 50\nsill 0 50 500 50").unwrap();
    let mut floor = Floor::new(world, seed.into());
    let mut pose = Pose2::new(if backwards { 300.0 } else { -300.0 }, 0.0, 0.0);
    let mm = if backwards { -1.0 } else { 1.0 };
    for _ in 0..600 {
        let rolled = floor.travel(Sides::new(mm, mm));
        let next = pose.advance_arc(rolled.left, rolled.right, 125.0);
        floor.cross(&room, &pose, &next, 125.0);
        pose = next;
    }
    pose
}

#[test]
fn sill_turns_and_brakes_robot_within_its_bounds() {
    let sill = only(|world| world.sill = Imperfections::default().sill);
    for backwards in [false, true] {
        let ends = (0..SEEDS).map(|seed| over_sills(&sill, seed, backwards));
        let ends: Vec<Pose2> = ends.collect();
        let turned = |pose: &Pose2| pose.heading_rad.to_degrees();
        let rms = (ends.iter().map(|p| turned(p).powi(2)).sum::<f64>() / f64::from(SEEDS)).sqrt();
        // Uniform within ±2°.
        assert!((rms - 1.155).abs() < 0.08, "{rms}");
        assert!(ends.iter().all(|pose| turned(pose).abs() <= 2.0 + 1e-9));
        let start = Pose2::new(if backwards { 300.0 } else { -300.0 }, 0.0, 0.0);
        let lost = |pose: &Pose2| 600.0 - start.distance_mm(pose);
        let mean = ends.iter().map(lost).sum::<f64>() / f64::from(SEEDS);
        // Uniform in 0 ..= 10 mm; the turn itself costs a tenth of a millimetre.
        assert!((mean - 5.1).abs() < 0.4, "{mean}");
        assert!(ends.iter().all(|pose| (-1e-9..10.5).contains(&lost(pose))));
    }
    let ideal = over_sills(&Imperfections::none(), 1, false);
    assert!(ideal.distance_mm(&Pose2::new(300.0, 0.0, 0.0)) < 1e-9);
}
