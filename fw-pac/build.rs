//! Hands the linker the memory map and `cortex-m-rt`'s script, for the microcontroller alone: a
//! host build must reach the `compile_error!` in `main.rs` and nothing else.

use std::path::PathBuf;
use std::{env, fs};

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=memory.x");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::copy("memory.x", out.join("memory.x")).expect("memory.x lies beside build.rs");
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    // Without it the linker aligns FLASH's segments to its page size.
    println!("cargo:rustc-link-arg-bins=--nmagic");
}
