//! The firmware in the loop: what would be flashed, on the virtual board, with the Pi's library and program.
//!
//! One program for all of them: it is linked once, and long and short tests of different files share the
//! cores. `cargo xtask test --only loop` runs it; where no test of the file runs `robot`, one file alone by
//! `ROBOT_ELF=$PWD/target/elf/fw-pac.elf cargo test --release -p twin -p robot-tests --test in_the_loop frames::`.

mod boot;
mod bringup;
mod buses;
mod calibrate;
mod doctor;
mod drive;
mod eeprom;
mod explore;
mod frames;
mod gyro;
mod link;
mod modes;
mod page;
#[cfg(target_os = "linux")]
mod pi_devices;
mod pose_control;
mod program;
mod reply_swap;
mod safe_state;
mod safety;
mod serve;
mod servo_scan;
mod sound_speed;
mod statistics;
mod teleop;
mod throughput;
mod tune;
mod velocity;
