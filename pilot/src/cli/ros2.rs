//! `ros2`: the robot as a node.

use super::args::Ros2;
use super::connection::{Context, interrupt};
use super::explore;
use host_link::error::Error;
use pilot::ros2::{self, Options, Ros2Node};

/// Runs the command.
pub fn run(arguments: &Ros2, context: Context<'_>) -> Result<(), Error> {
    let options = Options {
        namespace: arguments.namespace.clone(),
        domain: arguments.domain,
        localhost: arguments.localhost,
    };
    let (node, interrupt) = (Ros2Node::open(&options)?, interrupt()?);
    let domain = options.domain;
    let text = format!("node {} in the domain {domain}", node.name());
    context.output.message(&text);
    context.with_client(
        |connection| {
            if !arguments.yes {
                return Ok(());
            }
            explore::ensure_mode(connection, true, context)
        },
        |client| ros2::run(client, &interrupt, &node, |text| context.output.warn(text)),
    )
}
