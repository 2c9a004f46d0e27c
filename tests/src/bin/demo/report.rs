//! The bars of a run, from `ci/budget.toml`, and the page that shows its figures beside them.

use std::fmt::Write as _;

use serde_json::Value;

/// The bars of one kind of run.
pub struct Bars(Value);

impl Bars {
    /// Those of `ci/budget.toml`'s section.
    pub fn of(section: &str) -> Result<Self, toml::de::Error> {
        let budget: Value = toml::from_str(include_str!("../../../../ci/budget.toml"))?;
        Ok(Self(budget[section].clone()))
    }

    /// The bound of a figure: `≤` or `≥`, and the bar.
    fn bound(&self, key: &str) -> Option<(&'static str, f64)> {
        let mut bounds = [("≤", "at_most"), ("≥", "at_least")].into_iter();
        bounds.find_map(|(sign, bound)| Some((sign, self.0[bound][key].as_f64()?)))
    }

    /// Every bar that the run missed, as a sentence.
    pub fn missed(&self, report: &Value) -> Vec<String> {
        let sections = ["at_most", "at_least"].map(|bound| self.0[bound].as_object());
        let keys = sections.into_iter().flatten().flat_map(|bars| bars.keys());
        keys.filter_map(|key| {
            let (sign, bar) = self.bound(key)?;
            let flag = report[key].as_bool().map(|flag| f64::from(u8::from(flag)));
            let figure = report[key].as_f64().or(flag);
            let kept = figure.is_some_and(|figure| match sign {
                "≤" => figure <= bar,
                _ => figure >= bar,
            });
            (!kept).then(|| format!("{key} is {}, the bar is {sign} {bar}", report[key]))
        })
        .collect()
    }
}

/// What the page shows of the figures that the run has: `key|meaning|decimals|unit`.
const ROWS: &str = "\
path_m|path|1| m
way_points|way-points reached|0|
coverage|reachable floor that the map calls free|3|
map_iou|map agreement (IoU)|3|
map_precision|… precision|3|
map_recall|… recall|3|
raw_map_iou|map agreement by odometry alone|3|
position_error_mm_median|position error, median|1| mm
position_error_mm_max|position error, worst|2| mm
position_error_mm_end|position error, end|2| mm
heading_error_deg_max|heading error, worst|3|°
heading_error_deg_end|heading error, end|3|°
position_error_mm_max_with_latency|position error at the frame's end, up to a tick later|2| mm
heading_error_deg_max_with_latency|heading error at the frame's end|3|°
position_error_mm_median_start_frame|aligned at the start alone: position error, median|1| mm
position_error_mm_max_start_frame|… worst|1| mm
heading_error_deg_max_start_frame|… heading error, worst|2|°
map_iou_start_frame|… map agreement|3|
raw_position_error_mm_max|position error of odometry alone, worst|1| mm
raw_error_ratio|… times that of the corrected pose|1|
raw_heading_error_deg_max|heading error of odometry alone, worst|1|°
collisions|collisions|0|
frames_sent|frames sent|0|
frames_rejected|frames rejected|0|
unmodelled_registers|unmodelled registers|0|
stops|stops answered|0|
reset_to_ready_ms|reset to READY|0| ms
virtual_seconds|virtual time|1| s
wall_seconds|wall time|1| s
realtime_factor|faster than real time, driving (the host's speed)|1| ×
host_ms_per_robot_second|mapping and planning, host time a robot's second|1| ms
pi_core_share|… share of a Pi 3B+ core, estimated|3|";

/// The page that a person reads.
pub fn page(report: &Value, bars: &Bars, command: &str) -> String {
    let mut page = String::from("# The demo's run\n\n| figure | value | bar |\n|---|---|---|\n");
    for row in ROWS.lines() {
        let [key, meaning, decimals, unit] = row.split('|').collect::<Vec<_>>()[..] else {
            continue;
        };
        let Some((value, decimals)) = report[key].as_f64().zip(decimals.parse().ok()) else {
            continue;
        };
        let decimals: usize = decimals;
        let bar = bars.bound(key);
        let bar = bar.map_or(String::new(), |(sign, bar)| format!("{sign} {bar}{unit}"));
        let _ = writeln!(page, "| {meaning} | {value:.decimals$}{unit} | {bar} |");
    }
    let _ = write!(
        page,
        "\nErrors compare the pose in a frame with the truth at the last tick before it.\n\n\
         `map.png` the map · `map.pgm`, `map.yaml` the same for ROS map_server · `trajectory.png` estimated \
         against true path over the map and the true walls · `uart.log` the STM's log · `report.json` these \
         figures for scripts · `map-raw.*` the map by odometry alone · after exploring `error.png` the errors over \
         time, `recording.mcap` every report\n\nRepeat: `{command}`\n"
    );
    page
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn bar_missed_or_unmeasured_is_named() {
        let bars = Bars(json!({"at_most": {"a": 1, "b": 2}, "at_least": {"c": 3}}));
        let good = json!({"a": 1, "b": 0.5, "c": 3.5});
        assert!(bars.missed(&good).is_empty());
        let missed = bars.missed(&json!({"a": 1.5, "c": 2})).join("; ");
        let expected =
            "a is 1.5, the bar is ≤ 1; b is null, the bar is ≤ 2; c is 2, the bar is ≥ 3";
        assert_eq!(missed, expected);
        let page = page(&json!({"path_m": 2.25}), &Bars::of("tour").unwrap(), "x");
        assert!(page.contains("| path | 2.2 m | ≥ 25 m |"), "{page}");
    }
}
