//! Gates on the shape of the project: unsafe code, files, dependencies, sizes.

use std::collections::BTreeMap;

use serde_json::json;
use xshell::cmd;

use super::passed_without;
use crate::budget::Budget;
use crate::error::{Context, Result};
use crate::process::{self, captures};
use crate::session::Session;
use crate::toolchain::TARGET;
use crate::workspace::{list, text};

const FORBIDDEN: &str = "\nunsafe_code = \"forbid\"\n";

/// `unsafe` only in fw-pac, licences and lock file present and current, no toolchain file.
pub fn hygiene(session: &Session) -> Result<String> {
    let exists = |name| session.sh.path_exists(name);
    let forbids = |manifest: &str, lints: &[&str]| {
        let manifest = session.sh.read_file(manifest);
        manifest.is_ok_and(|manifest| lints.iter().any(|lint| manifest.contains(lint)))
    };
    // A lock file that cargo has to change, or that git does not keep, builds something else elsewhere.
    let current = process::output(session.cargo("metadata --locked --format-version 1"));
    let tracked = process::output(cmd!(session.sh, "git ls-files --error-unmatch Cargo.lock"));
    let tracked = tracked.is_some() || !exists(".git");
    let stale = "Cargo.lock is stale (`cargo metadata --locked` says why)";
    let mut findings = Vec::new();
    let mut require = |good: bool, finding: String| findings.extend((!good).then_some(finding));
    require(current.is_some(), stale.to_owned());
    require(tracked, "Cargo.lock is not committed".into());
    let unforbidden = |name: &str| format!("{name}: no lint forbids unsafe code");
    let forbidden = forbids("Cargo.toml", &[FORBIDDEN]);
    require(forbidden, unforbidden("Cargo.toml"));
    for package in session.packages()? {
        let (name, manifest) = (text(&package["name"]), text(&package["manifest_path"]));
        let lints = ["\n[lints]\nworkspace = true\n", FORBIDDEN];
        let good = name == "fw-pac" || forbids(manifest, &lints);
        require(good, unforbidden(name));
    }
    for name in ["LICENSE-MIT", "LICENSE-APACHE", "README.md"] {
        require(exists(name), format!("{name} is missing"));
    }
    for name in ["rust-toolchain", "rust-toolchain.toml"] {
        let reason = "breaks every cargo call where what it lists cannot be fetched";
        require(!exists(name), format!("{name}: {reason}"));
    }
    passed_without(&findings, "licences, lock file, lints".into())
}

/// Packages of the workspace, and the ones that they must not depend on, however indirectly, unless
/// an optional feature names them.
const ARROWS: [(&str, &str); 7] = [
    (
        "fw-core",
        "host-link pilot navigator mapper twin plant fw-pac",
    ),
    ("fw-pac", "host-link pilot navigator mapper twin plant"),
    ("host-link", "pilot navigator mapper twin plant fw-pac"),
    ("mapper", "fw-core host-link pilot navigator twin plant"),
    ("navigator", "fw-core host-link pilot twin plant"),
    ("pilot", "twin plant"),
    ("twin", "fw-core host-link pilot navigator mapper"),
];

/// The files of the Pi's program that set up the virtual board.
const VIRTUAL: [&str; 2] = ["pilot/src/cli/board_args.rs", "pilot/src/virtual_board.rs"];

/// The dependency arrows point one way; fw-core is the same code wherever it is built.
pub fn arrows(session: &Session) -> Result<String> {
    let mut findings = Vec::new();
    let packages = session.packages()?;
    for (from, forbidden) in ARROWS {
        let built = built_of(session, &format!("--package {from}"))?;
        let wrong = forbidden
            .split(' ')
            .filter(|name| built.contains_key(*name));
        findings.extend(wrong.map(|name| format!("{from} depends on {name}")));
    }
    // With the feature `virtual` all of the Pi's program could reach the room: its files that do.
    for (name, source) in session.texts("pilot/src", "rs")? {
        let sees = source.contains("plant::") || source.contains("twin::");
        if sees && !VIRTUAL.contains(&name.as_str()) {
            findings.push(format!("{name} sees the virtual room"));
        }
    }
    let direct = built_of(session, "--package fw-core --depth 1")?;
    if !direct.keys().eq(["fixed", "fw-core"]) {
        findings.push(format!("fw-core depends on {direct:?}, not on fixed alone"));
    }
    let mut core = packages.iter().filter(|one| one["name"] == "fw-core");
    let core = core.next().context("no package fw-core")?;
    if core["features"] != json!({}) {
        findings.push("fw-core has features".into());
    }
    for (name, source) in session.texts("fw-core/src", "rs")? {
        let conditions = conditions(&source).into_iter();
        findings.extend(conditions.map(|condition| format!("{name}: cfg({condition})")));
    }
    // What fw-core is built of in the proofs and in the firmware must be what it asks for alone.
    let alone = built_of(session, "--package fw-core")?;
    let firmware = format!("--package fw-pac --target {TARGET}");
    for package in ["--package proofs", &firmware] {
        let built = built_of(session, package)?;
        let differs = |(name, features): &(_, _)| built.get(*name) != Some(*features);
        let different = alone.iter().filter(differs);
        findings.extend(different.map(|(name, _)| format!("{package}: other features of {name}")));
    }
    passed_without(&findings, format!("{} packages", packages.len()))
}

/// The crates that a package is built of with its default features, itself included, each with its
/// version and features.
fn built_of(session: &Session, package: &str) -> Result<BTreeMap<String, String>> {
    let words = "tree --edges normal --no-dedupe --prefix none --format {p}[{f}]";
    let tree = session.cargo(&format!("{words} {package}"));
    let tree = tree.quiet().read()?;
    let crates = tree.lines().filter_map(|line| line.split_once(' '));
    let crates = crates.map(|(name, rest)| (name.to_owned(), rest.to_owned()));
    Ok(crates.collect())
}

/// What the conditions of `cfg(…)`, `cfg_attr(…)` and `cfg!(…)` name besides `test` and `kani`.
fn conditions(source: &str) -> Vec<&str> {
    let allowed = ["test", "kani", "not", "any", "all", ""];
    let patterns = [r"cfg!?\(([^\]{;]*)", r"cfg_attr\(([^,]*)"];
    // In a line that does not begin with a comment.
    let patterns = patterns.map(|cfg| format!(r"(?m)^ *(?:[^/\s].*?)?\b{cfg}"));
    let conditions = patterns.iter().flat_map(|cfg| captures(source, cfg));
    let words = conditions.flat_map(|found| found.split(['(', ')', ' ', '\n', ',', '=', '"']));
    words.filter(|word| !allowed.contains(word)).collect()
}

/// Lines of Rust, lines of the longest file, words of the documents.
pub fn size(session: &Session) -> Result<String> {
    let budget = Budget::read(session)?;
    let exempt = list(budget.value("line_limit.exempt")?);
    let limit = budget.value("size.at_most.file_lines")?.as_u64();
    let (mut lines, mut longest) = (0, 0);
    for (name, source) in session.texts("", "rs")? {
        let count = source.lines().count();
        lines += count;
        if !exempt.iter().any(|exempt| text(exempt) == name) {
            longest = longest.max(count);
            if Some(count as u64) > limit {
                println!("  {name}: {count} lines");
            }
        }
    }
    let documents = session.texts("docs", "md")?.into_iter();
    let words = documents.map(|(_, text)| text.split_whitespace().count());
    let words: usize = words.sum();
    let figure = format!("{lines} lines of Rust, {longest} in a file, {words} words in docs/");
    println!("  {figure}");
    let figures = json!({"rust_lines": lines, "file_lines": longest, "docs_words": words});
    budget.check("size", &figures)?;
    Ok(figure)
}

#[test]
fn condition_other_than_test_is_named() {
    let source = "#[cfg(test)]\n// #[cfg(never)]\n#[cfg(not(kani))]\n#[cfg(feature = \"x\")]\n\
                  #[cfg_attr(test, derive(Debug))]\nif cfg!(debug_assertions) {\n";
    assert_eq!(conditions(source), ["feature", "x", "debug_assertions"]);
}
