//! Between the server and the topics.

use super::commands::Commands;
use super::node::Ros2Node;
use super::reports;
use crate::client::{Client, View};
use crate::ros_messages::{BatteryState, OccupancyGrid, RANGE_FRAMES, Range};
use crate::serve::protocol::{Activity, Frame, Message, Request};
use host_link::board_io::Interrupt;
use host_link::error::Error;
use host_link::pose::Pose;
use ros2_client::Gid;
use std::collections::BTreeMap;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Time between two messages of battery, diagnostics and map, and between two warnings of a topic.
const SLOW: Duration = Duration::from_secs(1);

const CMD_VEL: &str = "/cmd_vel";
const GOAL_POSE: &str = "/goal_pose";
const ESTOP: &str = "/estop";

/// Publishes and drives until Ctrl-C. `warn` shows what is refused and which motion ended early;
/// `/rosout` has it, too.
///
/// # Errors
/// [`Error::Interrupted`], those of the client.
// Requirement: SERVE-ros2-1
pub fn run(
    client: &mut Client,
    interrupt: &Interrupt,
    node: &Ros2Node,
    warn: impl FnMut(&str),
) -> Result<(), Error> {
    let mut bridge = Bridge {
        node,
        warn,
        warned: BTreeMap::new(),
        commands: Commands::default(),
        view: View::default(),
        last: None,
        slow: None,
        map_changed: false,
    };
    client.request(&Request::Watch { every: 1 })?;
    loop {
        interrupt.check()?;
        if let Some(message) = client.message()? {
            bridge.publish(&message);
        }
        for (topic, request) in bridge.requests(Instant::now()) {
            if let Err(why) = client.request(&request) {
                bridge.refused(topic, &request, &why);
            }
        }
    }
}

struct Bridge<'a, W> {
    node: &'a Ros2Node,
    warn: W,
    /// When a topic was warned of.
    warned: BTreeMap<&'static str, Instant>,
    commands: Commands<Gid>,
    view: View,
    /// The latest pose, with its time on the board's clock.
    last: Option<(u64, Pose)>,
    slow: Option<Instant>,
    map_changed: bool,
}

impl<W: FnMut(&str)> Bridge<'_, W> {
    fn publish(&mut self, message: &Message) {
        self.view.take(message);
        match message {
            Message::Frame(frame) => self.publish_frame(frame),
            Message::Tiles { .. } => self.map_changed = true,
            Message::Done {
                activity,
                error: Some(error),
                ..
            } => {
                let drives = *activity == Activity::Drive;
                self.warn(if drives { CMD_VEL } else { GOAL_POSE }, &error.text);
            }
            _ => {}
        }
    }

    /// What cannot be published is that of a receiver that does not keep up.
    fn publish_frame(&mut self, frame: &Frame) {
        let (node, robot, us) = (self.node, &frame.robot, unix_us());
        let fresh = self.last.is_none_or(|(at, _)| at != robot.time_us);
        if let Some(pose) = robot.pose.filter(|_| fresh && frame.error.is_none()) {
            let now = (robot.time_us, pose);
            let last = self.last.replace(now);
            // A restart of the STM is no way that was driven.
            let last = last.filter(|&(us, pose)| !robot.has_jumped_since(us, pose));
            let _ = node.odom.publish(reports::odometry(us, now, last));
            let _ = node.tf.publish(reports::transforms(us, frame));
            let ranges = RANGE_FRAMES.into_iter().zip(robot.ranges_mm);
            for (topic, (name, mm)) in node.ranges.iter().zip(ranges) {
                let _ = topic.publish(Range::of(us, name, mm));
            }
        }
        let now = Instant::now();
        let is_early = |last| now.duration_since(last) < SLOW;
        if self.slow.is_some_and(is_early) {
            return;
        }
        self.slow = Some(now);
        let _ = node.battery.publish(BatteryState::of(us, robot));
        let _ = node.diagnostics.publish(reports::diagnostics(us, frame));
        if std::mem::take(&mut self.map_changed) {
            let _ = node.map.publish(OccupancyGrid::of(us, &self.view.grid()));
        }
    }

    /// What the topics ask for, a stop first.
    fn requests(&mut self, now: Instant) -> Vec<(&'static str, Request)> {
        let (node, commands) = (self.node, &mut self.commands);
        let stop = node.stops().filter_map(|stop| commands.stop(stop)).last();
        let goals = node.goals().map(|goal| commands.goal(&goal, now));
        let goals: Vec<_> = goals.collect();
        let velocities = node.velocities();
        let velocities = velocities.map(|(twist, from)| commands.velocity(from, &twist, now));
        let velocities: Vec<_> = velocities.collect();
        let keep = commands.keep(now);
        let stop = stop.map(|stop| (ESTOP, stop));
        let goal = self.latest(GOAL_POSE, goals);
        let velocity = self.latest(CMD_VEL, velocities);
        let keep = keep.map(|keep| (GOAL_POSE, keep));
        [stop, goal, velocity, keep].into_iter().flatten().collect()
    }

    /// Of a topic's messages the last one counts that is accepted.
    fn latest(
        &mut self,
        topic: &'static str,
        outcomes: Vec<Result<Request, String>>,
    ) -> Option<(&'static str, Request)> {
        let mut latest = None;
        for outcome in outcomes {
            match outcome {
                Ok(request) => latest = Some((topic, request)),
                Err(why) => self.warn(topic, &why),
            }
        }
        latest
    }

    /// The server has refused a request.
    fn refused(&mut self, topic: &'static str, request: &Request, why: &Error) {
        if topic == GOAL_POSE {
            self.commands.end_goal();
        }
        if *request != Request::Keep {
            self.warn(topic, &why.to_string());
        }
    }

    fn warn(&mut self, topic: &'static str, text: &str) {
        let now = Instant::now();
        let last = self.warned.get(topic);
        if last.is_none_or(|last| now.duration_since(*last) >= SLOW) {
            self.warned.insert(topic, now);
            let text = format!("{topic}: {text}");
            (self.warn)(&text);
            self.node.log(&text);
        }
    }
}

/// This computer's time, which ROS 2 stamps messages with.
fn unix_us() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    u64::try_from(since.unwrap_or_default().as_micros()).unwrap_or(u64::MAX)
}
