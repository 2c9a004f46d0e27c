//! The DDS end: topics with their types and qualities of service.

use crate::ros_messages::{
    BatteryState, Bool, DiagnosticArray, Message, OccupancyGrid, Odometry, PoseStamped,
    RANGE_FRAMES, Range, TfMessage, Twist,
};
use host_link::error::Error;
use ros2_client::dds::rustdds::DomainParticipantBuilder;
use ros2_client::qos::{Durability, History, WhenFull};
use ros2_client::ros2::LogLevel;
use ros2_client::{
    Context, Gid, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, QosProfile,
    Subscription, rosout,
};
use serde::de::DeserializeOwned;
use std::net::Ipv4Addr;

/// Messages that are kept until a receiver has them.
const DEPTH: usize = 10;
/// Most messages of a topic that are handled at a time.
const BATCH: usize = 100;

type Failure = Box<dyn std::error::Error>;

/// Where to take part.
#[derive(Clone, Debug)]
pub struct Options {
    /// Before every topic; empty, or `robot1` for `/robot1/odom`.
    pub namespace: String,
    /// Of DDS, 0 to 101.
    pub domain: u16,
    /// Speaks to this computer only.
    pub localhost: bool,
}

/// The node and its topics.
pub struct Ros2Node {
    node: Node,
    pub(super) odom: Publisher<Odometry>,
    pub(super) tf: Publisher<TfMessage>,
    pub(super) ranges: Vec<Publisher<Range>>,
    pub(super) battery: Publisher<BatteryState>,
    pub(super) diagnostics: Publisher<DiagnosticArray>,
    pub(super) map: Publisher<OccupancyGrid>,
    cmd_vel: Subscription<Twist>,
    goal_pose: Subscription<PoseStamped>,
    estop: Subscription<Bool>,
}

impl Ros2Node {
    /// Joins the domain.
    ///
    /// # Errors
    /// [`Error::Usage`] for a namespace that ROS 2 does not accept, [`Error::Device`] where the domain
    /// cannot be joined.
    pub fn open(options: &Options) -> Result<Self, Error> {
        let namespace = format!("/{}", options.namespace.trim_start_matches('/'));
        if Name::new(&namespace, "odom").is_err() {
            let what = "accepted are letters, digits and single underscores, with slashes between; a part begins \
                        with no digit";
            let namespace = &options.namespace;
            return Err(Error::Usage(format!("--namespace {namespace}: {what}")));
        }
        Self::join(&namespace, options).map_err(|cause| {
            let advice = "choose another --domain, or end a program that holds its UDP ports";
            Error::device(format!("the DDS domain {}", options.domain), cause, advice)
        })
    }

    fn join(namespace: &str, options: &Options) -> Result<Self, Failure> {
        let mut participant = DomainParticipantBuilder::new(options.domain);
        if options.localhost {
            participant = participant.with_only_networks([Ipv4Addr::LOCALHOST]);
        }
        let context = Context::from_domain_participant(participant.build()?)?;
        let name = NodeName::new(namespace, "robot")?;
        let mut node = context.new_node(name, NodeOptions::new())?;
        let fast = QosProfile::subscription_default();
        // A receiver that does not keep up loses messages; nothing here waits for it.
        let kept = fast.clone().reliability_reliable(WhenFull::Fail);
        let kept = kept.history(History::KeepLast { depth: DEPTH });
        let latched = kept.clone().durability(Durability::TransientLocal);
        let latched = latched.history(History::KeepLast { depth: 1 });
        let ranges = RANGE_FRAMES.iter();
        let ranges = ranges.map(|topic| publisher(&mut node, topic, &kept));
        Ok(Self {
            ranges: ranges.collect::<Result<_, _>>()?,
            odom: publisher(&mut node, "odom", &kept)?,
            tf: publisher(&mut node, "tf", &kept)?,
            battery: publisher(&mut node, "battery_state", &kept)?,
            diagnostics: publisher(&mut node, "diagnostics", &kept)?,
            map: publisher(&mut node, "map", &latched)?,
            // Matches senders of either reliability: a late velocity is worth nothing.
            cmd_vel: subscription(&mut node, "cmd_vel", &fast)?,
            goal_pose: subscription(&mut node, "goal_pose", &kept)?,
            estop: subscription(&mut node, "estop", &kept)?,
            node,
        })
    }

    /// The node's name with its namespace.
    pub fn name(&self) -> String {
        self.node.fully_qualified_name()
    }

    /// The messages on `/cmd_vel` since the last time, with their publishers.
    pub(super) fn velocities(&self) -> impl Iterator<Item = (Twist, Gid)> {
        taken(&self.cmd_vel)
    }

    /// Those on `/goal_pose`.
    pub(super) fn goals(&self) -> impl Iterator<Item = PoseStamped> {
        taken(&self.goal_pose).map(|(goal, _)| goal)
    }

    /// Those on `/estop`.
    pub(super) fn stops(&self) -> impl Iterator<Item = bool> {
        taken(&self.estop).map(|(stop, _)| stop.data)
    }

    /// Writes to `/rosout`.
    pub(super) fn log(&self, text: &str) {
        rosout!(self.node, LogLevel::Warn, "{text}");
    }
}

#[test]
fn namespace_that_is_none_is_refused_with_what_is_accepted() {
    let options = |namespace: &str| Options {
        namespace: namespace.into(),
        domain: 101,
        localhost: true,
    };
    for namespace in ["a b", "1a"] {
        let refused = Ros2Node::open(&options(namespace)).err();
        let refused = refused.unwrap().to_string();
        assert!(refused.contains(": accepted are letters"), "{refused}");
    }
}

/// What a subscription has got; what cannot be decoded is left out.
fn taken<M: DeserializeOwned + 'static>(
    subscription: &Subscription<M>,
) -> impl Iterator<Item = (M, Gid)> {
    let all = std::iter::from_fn(|| subscription.take().transpose()).take(BATCH);
    all.flatten()
        .map(|(message, info)| (message, info.publisher_gid()))
}

fn type_name<M: Message>() -> MessageTypeName {
    let (package, name) = M::NAME.split_once("/msg/").unwrap_or_default();
    MessageTypeName::new(package, name)
}

fn publisher<M: Message>(
    node: &mut Node,
    topic: &str,
    quality: &QosProfile,
) -> Result<Publisher<M>, Failure> {
    let topic = node.create_topic(&Name::new("", topic)?, type_name::<M>(), quality)?;
    Ok(node.create_publisher(&topic, None)?)
}

fn subscription<M: Message + DeserializeOwned + 'static>(
    node: &mut Node,
    topic: &str,
    quality: &QosProfile,
) -> Result<Subscription<M>, Failure> {
    let topic = node.create_topic(&Name::new("", topic)?, type_name::<M>(), quality)?;
    Ok(node.create_subscription(&topic, None)?)
}
