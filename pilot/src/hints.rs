//! What counters and faults indicate, as sentences with what to check.

use fw_core::eeprom::Config;
use fw_core::types::Faults;
use fw_core::wire::Cause;
use host_link::error::Error;
use host_link::snapshot::{Snapshot, silent_names};
use host_link::statistics::RejectCounts;

/// What to check; empty when all is well.
pub fn diagnose(snapshot: &Snapshot, config: &Config) -> Vec<String> {
    let mut hints = Vec::new();
    let link = &snapshot.link;
    rejected(&mut hints, "the Pi rejected replies", &link.causes);
    if let Some(missed) = link.missed.filter(|&missed| missed > 0) {
        hints.push(format!(
            "the Pi missed {missed} replies that the STM numbered: frames were rejected, or another program sends some"
        ));
    }
    let deadline_ms = u64::from(config.stop_deadline().0);
    let near_us = deadline_ms * 1000 / 2;
    if link.recent_gap_us >= near_us {
        hints.push(gap("the Pi's replies", link.recent_gap_us, deadline_ms));
    }
    if let Some(stm) = &snapshot.stm {
        let mut causes = stm.causes;
        // Every session begins with some; they are counted since the STM's start.
        causes.set(Cause::Stale, 0);
        rejected(&mut hints, "the STM rejected frames", &causes);
        if stm.lost > 0 {
            hints.push(format!(
                "the STM lost {} that came before it had read the one before: leave more time between frames (a lower --rate)",
                frames(stm.lost.into())
            ));
        }
        let recent_us = u64::from(stm.recent_gap_us);
        if recent_us >= near_us {
            hints.push(gap("the STM's frames", recent_us, deadline_ms));
        }
    }
    let silent = silent_names(snapshot.silent).map(Error::SilentRangefinder);
    hints.extend(silent.map(|error| error.to_string()));
    for fault in Faults::TABLE {
        if snapshot.faults.contains(&fault.name) {
            let is_battery =
                (Faults::BATTERY_LOW | Faults::BATTERY_CUTOFF).intersects(fault.faults);
            let charge = "charge the battery, then `robot reset`";
            let other =
                "in guarded modes a drive clears a lost link, `robot reset` clears all faults";
            let remedy = if is_battery { charge } else { other };
            let (name, text) = (fault.name, fault.text);
            hints.push(format!("latched fault {name}: {text}; {remedy}"));
        }
    }
    hints
}

/// So many frames.
pub fn frames(count: u64) -> String {
    format!("{count} frame{}", if count == 1 { "" } else { "s" })
}

/// Why a session that has lasted so long does not know the STM's end, if so.
pub fn no_log(snapshot: &Snapshot, error: Option<&str>) -> Option<String> {
    let why = error.unwrap_or(
        "its log has no line of it (slide switch, --uart, or a firmware without that line)",
    );
    let unknown = || format!("the STM's end of the link is not known: {why}");
    snapshot.stm.is_none().then(unknown)
}

fn gap(whose: &str, us: u64, deadline_ms: u64) -> String {
    format!(
        "{whose} were up to {} ms apart, the stop deadline is {deadline_ms} ms: look for what keeps the computer busy, or give a higher --rate",
        us / 1000
    )
}

fn rejected(hints: &mut Vec<String>, what: &str, causes: &RejectCounts) {
    for (cause, count) in causes.nonzero() {
        hints.push(format!(
            "{what} ({} {count}): {}",
            cause.name(),
            explanation(cause)
        ));
    }
}

/// What a cause indicates.
fn explanation(cause: Cause) -> &'static str {
    match cause {
        Cause::Short | Cause::Long => {
            "the two ends run different modes (`robot reset` makes the STM read the EEPROM again), or the \
             chip-select is disturbed"
        }
        Cause::Key => {
            "the two ends have different keys (`robot reset` makes the STM read the EEPROM again), or no \
             data comes over the wire"
        }
        Cause::Double => "the two ends run different modes, or the wire is noisy",
        Cause::Cell => {
            "the two ends have different numbers of cells or different modes, or the wire is noisy"
        }
        Cause::Stale => {
            "frames were repeated, or an end restarted, from which the fourth frame recovers"
        }
        Cause::Status | Cause::Velocity => {
            "the two ends are of different versions, or the wire is noisy"
        }
        Cause::Crc => {
            "the wire is noisy (shorten it, or lower --spi-hz), or the two ends run different modes"
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fw_core::eeprom::Image;
    use host_link::statistics::StmStatistics;

    fn first_board() -> Config {
        Config::decode(&Image::FIRST_BOARD).unwrap()
    }

    fn well() -> Snapshot {
        let mut snapshot = Snapshot::new(&first_board());
        // A single gap is no advice for ever.
        snapshot.link.worst_gap_us = 2_000_000;
        snapshot.stm = Some(StmStatistics {
            frames: 40,
            accepted: 40,
            recent_gap_us: 25_000,
            // Before this session there may have been hours without a frame.
            worst_gap_us: u32::MAX,
            ..StmStatistics::default()
        });
        snapshot
    }

    #[test]
    fn hints_good_link_has_none() {
        assert_eq!(diagnose(&well(), &first_board()), Vec::<String>::new());
    }

    #[test]
    fn hint_without_the_stms_end_names_the_cause() {
        let mut snapshot = well();
        assert_eq!(no_log(&snapshot, None), None);
        snapshot.stm = None;
        let hint = |error| no_log(&snapshot, error).unwrap();
        assert!(hint(None).contains("slide switch") && hint(Some("no port")).ends_with("no port"));
    }

    #[test]
    fn hints_explain_each_cause_at_each_end() {
        for cause in Cause::ALL {
            let mut causes = RejectCounts::default();
            causes.set(cause, 3);
            let counted = format!("({} 3): ", cause.name());
            let [mut pi, mut stm] = [well(), well()];
            pi.link.causes = causes;
            stm.stm.as_mut().unwrap().causes = causes;
            for (snapshot, end) in [(pi, "the Pi"), (stm, "the STM")] {
                let hints = diagnose(&snapshot, &first_board());
                let names = |hint: &String| hint.contains(&counted) && hint.starts_with(end);
                let hinted = hints.iter().any(names);
                let is_start = end == "the STM" && cause == Cause::Stale;
                assert_eq!(
                    (hints.len(), hinted),
                    (usize::from(!is_start), !is_start),
                    "{hints:?}"
                );
            }
        }
    }

    #[test]
    fn hints_name_gaps_lost_frames_and_faults() {
        let mut snapshot = well();
        snapshot.link.recent_gap_us = 125_000;
        snapshot.link.missed = Some(2);
        let stm = snapshot.stm.as_mut().unwrap();
        (stm.recent_gap_us, stm.lost) = (125_000, 1);
        snapshot.faults = vec!["link-lost", "battery-low"];
        snapshot.silent[2] = true;
        let hints = diagnose(&snapshot, &first_board()).join("\n");
        for expected in [
            "missed 2 replies",
            "the Pi's replies were up to 125 ms",
            "lost 1 frame that",
            "the STM's frames were up to 125 ms",
            "a drive clears a lost link",
            "charge the battery",
            "the left rangefinder does not answer",
        ] {
            assert!(hints.contains(expected), "{expected}: {hints}");
        }
    }
}
