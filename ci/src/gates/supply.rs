//! The gate on the dependencies.

use super::{passed, skipped, Context, Verdict};
use crate::error::Result;
use crate::shell;

pub fn supply(context: &mut Context) -> Result<Verdict> {
    let place = &context.place;
    if shell::ask(place.cargo().args(["deny", "--version"])).is_none() {
        return skipped("cargo-deny is not installed (`cargo install --locked cargo-deny`)");
    }
    // Advisories need the network; the nightly workflow looks at them.
    shell::run(
        place
            .cargo()
            .args(["deny", "check", "bans", "licenses", "sources"]),
    )?;
    passed("bans, licenses, sources")
}
