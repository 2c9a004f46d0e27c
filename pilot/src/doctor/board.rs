//! The board without motion: lines, EEPROM, READY, link, log, battery.

use super::Findings;
use crate::hints;
use fw_core::eeprom::{Config, Image, KEY};
use fw_core::types::Faults;
use host_link::board_io::BoardIo;
use host_link::eeprom::{self, chip};
use host_link::error::Error;
use host_link::reset;
use host_link::session::Session;
use host_link::settings;
use host_link::snapshot::Snapshot;

/// How long the link is watched, microseconds: the STM logs its end once a second.
const LINK_US: u64 = 2_200_000;

/// Names of the checks that need the EEPROM, each of them all before it, in order.
const AFTER_EEPROM: [&str; 8] = [
    "EEPROM key",
    "configuration",
    "READY",
    "link",
    "log port",
    "firmware",
    "faults",
    "battery",
];

/// Checks the board; the EEPROM's content, if the robot can be driven by it.
///
/// # Errors
/// [`Error::Interrupted`].
// Requirement: WIRE-program-4
pub fn check(
    io: &mut BoardIo,
    rate_hz: u32,
    ready_timeout_ms: u32,
    findings: &mut Findings,
) -> Result<Option<Image>, Error> {
    match io.set_idle() {
        Ok(()) => findings.pass("lines", "SELECT, WP_EEPROM and RESET can be driven"),
        Err(error) => {
            let advice = "end the other program that holds the GPIO, and join the group gpio";
            findings.fail("lines", error.to_string(), advice);
            findings.skip(&["bus switch", "EEPROM"], "the lines cannot be driven");
            findings.skip(&AFTER_EEPROM, "the lines cannot be driven");
            return Ok(None);
        }
    }
    let own = chip::answers(io);
    findings.judge(
        "bus switch",
        !own,
        format!(
            "with SELECT low the EEPROM {} the Pi",
            if own { "answers" } else { "is hidden from" }
        ),
        "check SELECT (GPIO 4) and the I2C switch: the STM cannot read its configuration",
    );
    let image = match eeprom::read(io) {
        Ok(image) => image,
        Err(Error::Interrupted) => return Err(Error::Interrupted),
        Err(error) => {
            let advice =
                "enable I2C (dtparam=i2c_arm=on), check SDA, SCL, SELECT and the EEPROM's supply";
            findings.fail("EEPROM", error.to_string(), advice);
            findings.skip(&AFTER_EEPROM, "the EEPROM cannot be read");
            return Ok(None);
        }
    };
    findings.pass("EEPROM", "it answers at 0x50");
    let has_key = image.0.starts_with(&KEY);
    let found = if has_key {
        "right"
    } else if image == Image::BLANK {
        "the EEPROM is blank"
    } else {
        "the EEPROM is foreign"
    };
    let advice = "write a configuration: `robot eeprom init FILE`, then `robot eeprom write FILE`";
    findings.judge("EEPROM key", has_key, found.into(), advice);
    let config = match settings::decode(&image) {
        Ok(config) => config,
        Err(why) => {
            if has_key {
                let advice = "correct the file and run `robot eeprom write FILE`";
                findings.fail("configuration", why.to_string(), advice);
            } else {
                findings.skip(&["configuration"], "the EEPROM has no key");
            }
            findings.skip(&AFTER_EEPROM[2..], "there is no accepted configuration");
            return Ok(None);
        }
    };
    let mode = config.mode().name();
    findings.pass("configuration", format!("accepted, CRC right, mode {mode}"));
    match reset::await_ready(io, ready_timeout_ms) {
        Ok(_) => findings.pass("READY", "high"),
        Err(Error::Interrupted) => return Err(Error::Interrupted),
        Err(error) => {
            let advice = "read the UART log; check the STM's supply (boot awaits 2.76 V), flash the firmware";
            findings.fail("READY", error.to_string(), advice);
            findings.skip(&AFTER_EEPROM[3..], "the STM is not ready");
            return Ok(None);
        }
    }
    link(io, &config, rate_hz, findings)?;
    Ok(findings.failed().is_empty().then_some(image))
}

const LINK_ADVICE: &str =
    "check the SPI wires and --spi-hz; `robot reset` makes the STM read keys and mode again";

/// Two seconds of frames without a command.
fn link(
    io: &mut BoardIo,
    config: &Config,
    rate_hz: u32,
    findings: &mut Findings,
) -> Result<(), Error> {
    let mut session = Session::with_config(io, config.clone(), rate_hz);
    let (mut snapshot, logged, ended) = session.observe(LINK_US)?;
    let log_error = session.log_error().map(str::to_owned);
    let faults = std::mem::take(&mut snapshot.faults);
    let hints = hints::diagnose(&snapshot, config);
    match (ended, hints.as_slice()) {
        (Some(error), _) => {
            findings.fail("link", error.to_string(), LINK_ADVICE);
            findings.skip(&AFTER_EEPROM[4..], "no frames come");
            return Ok(());
        }
        (None, []) => findings.pass("link", quality(&snapshot)),
        (None, hints) => findings.fail("link", hints.join("; "), LINK_ADVICE),
    }
    log(&snapshot, log_error, logged, findings);
    let own_checks = Faults::LINK_LOST
        .union(Faults::BATTERY_LOW)
        .union(Faults::BATTERY_CUTOFF)
        .union(Faults::FRAME_REJECTED)
        .union(Faults::GYRO_LOST);
    let latched = Faults::TABLE
        .iter()
        .filter(|one| faults.contains(&one.name));
    let others = latched.filter(|one| !own_checks.intersects(one.faults));
    let others = others.map(|one| format!("{}: {}", one.name, one.text));
    let others: Vec<_> = others.collect();
    let found = match others.as_slice() {
        [] => "none latched".into(),
        others => others.join("; "),
    };
    let advice = "remove the cause, then run `robot reset`";
    findings.judge("faults", others.is_empty(), found, advice);
    battery(&snapshot, config, findings);
    Ok(())
}

fn quality(snapshot: &Snapshot) -> String {
    let link = &snapshot.link;
    format!(
        "{} frames, {} rejected, longest gap {} ms",
        link.frames,
        link.rejected,
        link.worst_gap_us / 1000
    )
}

/// The log's port, and whether its lines are those of this program's firmware.
fn log(snapshot: &Snapshot, error: Option<String>, bytes: usize, findings: &mut Findings) {
    let advice =
        "set the slide switch to the Pi, free the port of its console, and name it with --uart";
    if bytes == 0 {
        let found = error.unwrap_or_else(|| "no byte within two seconds".into());
        findings.fail("log port", found, advice);
        findings.skip(&["firmware"], "there is no log");
        return;
    }
    findings.pass("log port", format!("{bytes} bytes"));
    findings.judge(
        "firmware",
        snapshot.stm.is_some(),
        match snapshot.stm.map(|stm| stm.frames) {
            Some(frames) => format!("frames and log are this program's; {frames} since its reset"),
            None => "its log has no line of the link".into(),
        },
        "flash the firmware of this program's version (`cargo xtask flash`)",
    );
}

/// Highest voltage of a full cell with the ADC's error.
const FULL_V: f64 = 4.35;

fn battery(snapshot: &Snapshot, config: &Config, findings: &mut Findings) {
    let warn: f64 = config.battery_warn().0.to_num();
    let good = |cell: &Option<f64>| cell.is_some_and(|volts| (warn..=FULL_V).contains(&volts));
    let volts = snapshot.cells_v.iter().map(|cell| match cell {
        Some(volts) => format!("{volts:.2}"),
        None => "no value".into(),
    });
    let found = format!("{} V", volts.collect::<Vec<_>>().join(", "));
    let advice =
        "charge the battery; check the dividers (`robot tune battery`) and the balance plug";
    findings.judge("battery", snapshot.cells_v.iter().all(good), found, advice);
}
