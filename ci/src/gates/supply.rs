//! The gate on the dependencies.

use super::{passed, skipped, Context, Verdict};
use crate::error::{Error, Result};
use crate::shell;
use crate::tool::Tool;

const CARGO_DENY: Tool = Tool {
    subcommand: "deny",
    version: "0.20.2",
};

/// Every workspace with a lock file of its own, by its manifest.
const WORKSPACES: [&str; 3] = ["Cargo.toml", "fuzz/Cargo.toml", "tests/bench/Cargo.toml"];

pub fn supply(context: &mut Context) -> Result<Verdict> {
    let place = &context.place;
    let found = match CARGO_DENY.find(place) {
        Err(Error::Missing(why)) => return skipped(why),
        found => found?,
    };
    for manifest in WORKSPACES {
        let mut deny = CARGO_DENY.command(place, &found);
        // Locked: what is committed is what is looked at.
        deny.args(["--locked", "--manifest-path", manifest]);
        deny.args(["--config", "deny.toml", "check", "--hide-inclusion-graph"]);
        // One list for all of them: not each has what is excepted.
        deny.args(["--allow", "license-exception-not-encountered"]);
        // Advisories need the network; the nightly workflow looks at them.
        shell::run(deny.args(["bans", "licenses", "sources"]))?;
    }
    passed(format!(
        "bans, licenses, sources of {} workspaces",
        WORKSPACES.len()
    ))
}
