use super::*;

fn part() -> Mpu6050 {
    Mpu6050::new(GyroParams::default(), 1)
}

fn set(part: &mut Mpu6050, register: usize, value: u8) {
    assert!(part.start(ADDRESS, false));
    assert!(part.write(u8::try_from(register).unwrap()) && part.write(value));
    part.stop();
}

fn get(part: &mut Mpu6050, register: usize, count: usize) -> Vec<u8> {
    assert!(part.start(ADDRESS, false));
    assert!(part.write(u8::try_from(register).unwrap()));
    assert!(part.start(ADDRESS, true));
    let bytes = (0..count).map(|_| part.read()).collect();
    part.stop();
    bytes
}

fn rate(part: &mut Mpu6050) -> i16 {
    let bytes = get(part, GYRO_ZOUT, 2);
    i16::from_be_bytes([bytes[0], bytes[1]])
}

/// Awake at ±500 °/s, 42 Hz, a sample a millisecond.
fn awake() -> Mpu6050 {
    let mut part = part();
    set(&mut part, PWR_MGMT_1, 3);
    set(&mut part, CONFIG, 3);
    set(&mut part, GYRO_CONFIG, 8);
    part
}

#[test]
fn part_powers_up_asleep_with_its_identity() {
    let mut part = part();
    assert_eq!(get(&mut part, WHO_AM_I, 1), [0x68]);
    assert_eq!(get(&mut part, PWR_MGMT_1, 1), [0x40]);
    for ms in 0..100 {
        part.step_ms(ms * 1_000_000, 100.0);
    }
    assert_eq!(rate(&mut part), 0);
    set(&mut part, WHO_AM_I, 1);
    assert_eq!(get(&mut part, WHO_AM_I, 1), [0x68]);
    assert!(!part.start(0x69, false));
}

#[test]
fn rate_has_bias_scale_delay_and_saturation() {
    let mut part = awake();
    part.params.noise_deg_s = 0.0;
    let mut risen = None;
    for ms in 0..100 {
        part.step_ms(ms * 1_000_000, 100.0);
        if risen.is_none() && f64::from(rate(&mut part)) > (51.0 - 3.7) * 65.5 {
            risen = Some(ms + 1);
        }
    }
    let expected = (102.0 - 3.7) * 65.5;
    assert!((f64::from(rate(&mut part)) - expected).abs() < 2.0);
    assert!(matches!(risen, Some(4..=6)), "half of it: {risen:?} ms");
    for ms in 100..200 {
        part.step_ms(ms * 1_000_000, -700.0);
    }
    assert_eq!(rate(&mut part), i16::MIN);
    set(&mut part, GYRO_CONFIG, 0x10);
    part.step_ms(200_000_000, -700.0);
    assert!((f64::from(rate(&mut part)) + 717.7 * 32.75).abs() < 40.0);
}

#[test]
fn bias_drifts_with_time_since_power_up() {
    let mut part = awake();
    part.params = GyroParams {
        drift_deg_s_min: 0.6,
        ..GyroParams::exact()
    };
    for (minutes, expected) in [(0, 0.0), (5, 3.0), (10, 6.0)] {
        part.step_ms(minutes * 60_000_000_000, 0.0);
        assert!((f64::from(rate(&mut part)) / 65.5 - expected).abs() < 0.02);
    }
}

#[test]
fn noise_depends_on_seed_and_has_stated_size() {
    let draw = |seed| {
        let mut part = Mpu6050::new(GyroParams::default(), seed);
        set(&mut part, PWR_MGMT_1, 0);
        let sample = |ms: u64| {
            part.step_ms(ms * 1_000_000, 0.0);
            rate(&mut part)
        };
        (0..2000).map(sample).collect::<Vec<i16>>()
    };
    let words = draw(4);
    assert_eq!(words, draw(4));
    assert_ne!(words, draw(3));
    let mean = words.iter().map(|&w| f64::from(w)).sum::<f64>() / 2000.0;
    let square = words.iter().map(|&w| (f64::from(w) - mean).powi(2));
    let deviation = (square.sum::<f64>() / 2000.0).sqrt() / 131.0;
    assert!((mean / 131.0 + 3.7).abs() < 0.01 && (deviation - 0.05).abs() < 0.005);
}

#[test]
fn sample_rate_divider_sets_period() {
    let mut part = awake();
    set(&mut part, SMPLRT_DIV, 9);
    let mut words = Vec::new();
    for ms in 0..1000 {
        part.step_ms(ms * 1_000_000, 0.0);
        words.push(rate(&mut part));
    }
    words.dedup();
    assert!((85..=101).contains(&words.len()), "{}", words.len());
}

#[test]
fn interrupt_pulses_or_holds_until_status_is_read() {
    let mut part = awake();
    part.step_ms(0, 0.0);
    assert!(!part.interrupt(0), "not enabled");
    set(&mut part, INT_ENABLE, 1);
    part.step_ms(1_000_000, 0.0);
    assert!(part.interrupt(1_000_000) && part.interrupt(1_049_999));
    assert_eq!(part.next_event(), Some(1_050_000));
    assert!(!part.interrupt(1_050_000));
    set(&mut part, INT_PIN_CFG, INT_HELD | INT_LOW);
    part.step_ms(2_000_000, 0.0);
    assert!(!part.interrupt(2_900_000), "active low");
    let _ = rate(&mut part);
    assert!(!part.interrupt(2_900_000), "not what clears it");
    assert_eq!(get(&mut part, INT_STATUS, 1), [1]);
    assert!(part.interrupt(2_900_000));
}

#[test]
fn faults_change_acknowledge_identity_and_data() {
    let mut part = awake();
    part.fault = Mpu6050Fault::RefusesAfter(1);
    assert!(part.start(ADDRESS, false) && part.write(0x1A) && !part.write(3));
    part.fault = Mpu6050Fault::WrongId(0x70);
    assert_eq!(get(&mut part, WHO_AM_I, 1), [0x70]);
    part.fault = Mpu6050Fault::Frozen;
    part.step_ms(0, 10.0);
    let stands = rate(&mut part);
    part.step_ms(1_000_000, 50.0);
    assert_eq!(rate(&mut part), stands);
    part.fault = Mpu6050Fault::Silent;
    assert!(!part.start(ADDRESS, false));
    part.fault = Mpu6050Fault::None;
    set(&mut part, PWR_MGMT_1, RESET);
    assert_eq!(get(&mut part, GYRO_CONFIG, 1), [0]);
}
