//! The gates, the demo and the set-up, as one program: `cargo xtask …`.
fn main() {}
