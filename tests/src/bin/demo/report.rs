//! The figures of a run, the bars they must keep, and the page that shows both.

use std::fmt::Write as _;

use serde::Serialize;

/// What the run must keep to.
struct Bars {
    path_m: f64,
    position_error_mm: f64,
    heading_error_deg: f64,
    map_iou: f64,
    realtime_factor: f64,
}

const BARS: Bars = Bars {
    path_m: 25.0,
    position_error_mm: 30.0,
    heading_error_deg: 1.0,
    map_iou: 0.6,
    realtime_factor: 5.0,
};

/// The figures of a run; the keys of `report.json`.
#[derive(Serialize)]
pub struct Report {
    pub seed: u64,
    pub virtual_seconds: f64,
    pub wall_seconds: f64,
    pub realtime_factor: f64,
    pub driving_virtual_seconds: f64,
    pub path_m: f64,
    pub way_points: usize,
    pub frames_sent: u64,
    pub frames_accepted: u32,
    pub frames_rejected: u32,
    pub reset_to_ready_ms: u32,
    pub position_error_mm_max: f64,
    pub heading_error_deg_max: f64,
    pub position_error_mm_max_with_latency: f64,
    pub heading_error_deg_max_with_latency: f64,
    pub position_error_mm_end: f64,
    pub heading_error_deg_end: f64,
    pub map_iou: f64,
    pub map_precision: f64,
    pub map_recall: f64,
    pub collisions: u32,
    pub instructions: u64,
    pub stack_used_bytes: u64,
    pub unmodelled_registers: usize,
    pub unmodelled: Vec<String>,
    pub missed_bars: Vec<String>,
}

impl Report {
    /// Every bar that the run missed, as a sentence.
    pub fn missed(&self) -> Vec<String> {
        let mut missed = Vec::new();
        let mut bar = |kept: bool, text: String| {
            if !kept {
                missed.push(text);
            }
        };
        bar(
            self.path_m >= BARS.path_m,
            format!("path {:.1} m below {} m", self.path_m, BARS.path_m),
        );
        bar(
            self.position_error_mm_max <= BARS.position_error_mm,
            format!(
                "position error {:.1} mm above {} mm",
                self.position_error_mm_max, BARS.position_error_mm
            ),
        );
        bar(
            self.heading_error_deg_max <= BARS.heading_error_deg,
            format!(
                "heading error {:.2}° above {}°",
                self.heading_error_deg_max, BARS.heading_error_deg
            ),
        );
        bar(
            self.map_iou >= BARS.map_iou,
            format!("map_iou {:.3} below {}", self.map_iou, BARS.map_iou),
        );
        bar(
            self.frames_rejected == 0,
            format!("{} frames rejected", self.frames_rejected),
        );
        bar(
            self.collisions == 0,
            format!("{} collisions", self.collisions),
        );
        bar(
            self.unmodelled_registers == 0,
            format!("unmodelled registers: {}", self.unmodelled.join("; ")),
        );
        missed
    }

    /// The page that a person reads.
    pub fn page(&self) -> String {
        let mut page =
            String::from("# The demo's run\n\n| figure | value | bar |\n|---|---|---|\n");
        let mut row = |figure: &str, value: String, bar: String| {
            let _ = writeln!(page, "| {figure} | {value} | {bar} |");
        };
        let none = String::new;
        row(
            "path",
            format!("{:.1} m", self.path_m),
            format!("≥ {} m", BARS.path_m),
        );
        row("way-points reached", self.way_points.to_string(), none());
        row(
            "position error, worst",
            format!("{:.2} mm", self.position_error_mm_max),
            format!("≤ {} mm", BARS.position_error_mm),
        );
        row(
            "the same at the frame's end, up to a tick later",
            format!(
                "{:.2} mm, {:.3}°",
                self.position_error_mm_max_with_latency, self.heading_error_deg_max_with_latency
            ),
            none(),
        );
        row(
            "position error, end",
            format!("{:.2} mm", self.position_error_mm_end),
            none(),
        );
        row(
            "heading error, worst",
            format!("{:.3}°", self.heading_error_deg_max),
            format!("≤ {}°", BARS.heading_error_deg),
        );
        row(
            "heading error, end",
            format!("{:.3}°", self.heading_error_deg_end),
            none(),
        );
        row(
            "map agreement (IoU)",
            format!(
                "{:.3} (precision {:.3}, recall {:.3})",
                self.map_iou, self.map_precision, self.map_recall
            ),
            format!("≥ {}", BARS.map_iou),
        );
        row(
            "frames sent / rejected",
            format!("{} / {}", self.frames_sent, self.frames_rejected),
            "0 rejected".into(),
        );
        row("collisions", self.collisions.to_string(), "0".into());
        row(
            "unmodelled registers",
            self.unmodelled_registers.to_string(),
            "0".into(),
        );
        row(
            "reset to READY",
            format!("{} ms", self.reset_to_ready_ms),
            none(),
        );
        row(
            "virtual time",
            format!("{:.1} s", self.virtual_seconds),
            none(),
        );
        row("wall time", format!("{:.1} s", self.wall_seconds), none());
        row(
            "faster than real time, driving",
            format!("{:.1} ×", self.realtime_factor),
            format!(
                "≥ {} × (not a gate: it is the host's speed)",
                BARS.realtime_factor
            ),
        );
        let _ = write!(
            page,
            "\nErrors compare the pose in a frame with the truth at the tick it was computed in, without wheel \
             slip.\n\n\
             `map.png` the map · `map.pgm`, `map.yaml` the same for ROS map_server · `trajectory.png` estimated \
             against true path over the map and the true walls · `uart.log` the STM's log · `report.json` these \
             figures for scripts\n\nRepeat: `cargo xtask demo --seed {}`\n",
            self.seed
        );
        page
    }
}
