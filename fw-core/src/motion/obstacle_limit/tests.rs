use super::*;

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
