use super::*;
use crate::Params;

const SEEDS: u32 = 400;

/// A figure that is drawn uniformly within `bound` of `centre`, and `ideal` where it is not.
fn assert_uniform(name: &str, centre: f64, bound: f64, ideal: f64, of: impl Fn(&Params) -> f64) {
    let on = Imperfections::default();
    let draws = || (0..SEEDS).map(|seed| of(&on.draw(Params::default(), seed.into())) - centre);
    let sigma = (draws().map(|off| off * off).sum::<f64>() / f64::from(SEEDS)).sqrt();
    let stated = bound / 3f64.sqrt();
    assert!((sigma / stated - 1.0).abs() < 0.12, "{name}: {sigma}");
    assert!(draws().all(|off| off.abs() <= bound), "{name}");
    let mean = draws().sum::<f64>() / f64::from(SEEDS);
    assert!(mean.abs() < 0.15 * bound, "{name}: {mean}");
    let off = of(&Imperfections::none().draw(Params::default(), 1));
    assert!((off - ideal).abs() < 1e-12, "{name}: {off}");
}

#[test]
fn drawn_figures_are_uniform_within_their_bounds() {
    let (left, right) = (|p: &Params| p.motors.left, |p: &Params| p.motors.right);
    let wheels = |p: &Params| p.chassis.wheel_diameter_mm;
    assert_uniform("left wheel", 80.0, 0.24, 80.0, |p| wheels(p).left);
    assert_uniform("right wheel", 80.0, 0.24, 80.0, |p| wheels(p).right);
    assert_uniform("track", 125.0, 0.625, 125.0, |p| p.chassis.track_mm);
    assert_uniform("speed", 98.83, 9.883, 98.83, |p| left(p).speeds_deg_s[0]);
    assert_uniform("dead zone", 0.23, 0.0345, 0.23, |p| right(p).dead_zone);
    assert_uniform("lag", 0.1516, 0.02274, 0.1516, |p| right(p).lag_s);
    assert_uniform("charge", 0.8, 0.2, 0.85, |p| p.battery.charge[0]);
    assert_uniform("resistance", 0.06, 0.02, 0.06, |p| p.battery.cell_ohm);
    let none = Imperfections::none();
    let params = |world: &Imperfections| world.draw(Params::default(), 1);
    assert_eq!(params(&none), Params::default());
    let no_drive = Imperfections {
        drive: None,
        ..Imperfections::default()
    };
    // The draws are independent.
    let chassis = params(&Imperfections::default()).chassis;
    assert_eq!(params(&no_drive).chassis, chassis);
}

#[test]
fn drawn_gyro_has_stated_errors() {
    let draw = |world: Imperfections, seed| world.draw_gyro(GyroParams::exact(), seed);
    let parts = (0..SEEDS.into()).map(|seed| draw(Imperfections::default(), seed));
    let parts: Vec<GyroParams> = parts.collect();
    let count = f64::from(SEEDS);
    let rms = |of: fn(&GyroParams) -> f64| {
        (parts.iter().map(|p| of(p).powi(2)).sum::<f64>() / count).sqrt()
    };
    let most = |of: fn(&GyroParams) -> f64| parts.iter().map(|p| of(p).abs()).fold(0.0, f64::max);
    let bias = |p: &GyroParams| p.bias_deg_s;
    let scale = |p: &GyroParams| p.scale - 1.0;
    assert!((rms(bias) - 11.55).abs() < 1.0 && most(bias) <= 20.0);
    assert!((rms(scale) - 0.00577).abs() < 0.0006 && most(scale) <= 0.01);
    let rising = parts.iter().filter(|p| p.drift_deg_s_min > 0.0).count();
    assert!((150..250).contains(&rising), "{rising}");
    for part in &parts {
        assert!((part.drift_deg_s_min.abs() - 0.02).abs() < 1e-12);
        assert!((part.noise_deg_s - 0.05).abs() < 1e-12);
        let hour = part.reading_deg_s(100.0, 3600.0) - part.reading_deg_s(100.0, 0.0);
        assert!((hour.abs() - 1.2).abs() < 1e-9);
    }
    assert_eq!(draw(Imperfections::none(), 1), GyroParams::exact());
}

#[test]
fn every_imperfection_is_switched_off_by_its_name() {
    let world = Imperfections::default();
    let accepted = world.without("").unwrap_err();
    let mut names = accepted.strip_prefix("accepted are ").unwrap().split(", ");
    let off = names.try_fold(world, Imperfections::without);
    assert_eq!(off, Ok(Imperfections::none()));
}
