//! The source of randomness of a run.

use rand_distr::{Distribution, StandardNormal, StandardUniform};
use rand_pcg::rand_core::SeedableRng;
use rand_pcg::Pcg64Mcg;

/// A seeded generator (PCG-64): the same seed yields the same numbers on every machine.
#[derive(Clone, Debug)]
pub struct Rng(Pcg64Mcg);

impl Rng {
    /// A generator for this seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self(Pcg64Mcg::seed_from_u64(seed))
    }

    /// Uniform in 0 (included) .. 1 (excluded).
    pub fn unit(&mut self) -> f64 {
        StandardUniform.sample(&mut self.0)
    }

    /// Normally distributed with mean 0 and standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }
}
