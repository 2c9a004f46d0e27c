//! Every theorem on the fuzzer's inputs.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| proofs::run(data));
