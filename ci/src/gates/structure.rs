//! Gates on the shape of the project: unsafe code, files, dependencies, sizes.

use std::collections::BTreeSet;

use proc_macro2::{TokenStream, TokenTree};
use serde_json::{json, Value};
use xshell::cmd;

use super::source::WORKSPACES;
use super::Outcome::{self, Passed};
use super::{check_bars, passed_without};
use crate::budget::Budget;
use crate::error::{anyhow, Context, Result};
use crate::process;
use crate::session::Session;
use crate::toolchain::TARGET;
use crate::workspace::{list, text};

/// The one package that may be unsafe: it writes registers.
const UNSAFE_PACKAGE: &str = "fw-pac";

/// `unsafe` only in fw-pac, licences and lock files present and current, no toolchain file.
pub fn hygiene(session: &Session) -> Result<Outcome> {
    let workspace = &session.workspace;
    let mut findings = Vec::new();
    for package in workspace.packages("Cargo.toml")? {
        for target in list(&package["targets"]) {
            let shipped = ["lib", "bin"].contains(&text(&target["kind"][0]));
            let root = text(&target["src_path"]);
            let forbids = workspace
                .read(root)?
                .contains("\n#![forbid(unsafe_code)]\n");
            if shipped && text(&package["name"]) != UNSAFE_PACKAGE && !forbids {
                findings.push(format!("{root}: no #![forbid(unsafe_code)]"));
            }
        }
    }
    let files = workspace.rust_files()?;
    for file in &files {
        let name = workspace.relative(file).to_string();
        let tokens = tokens(&workspace.read(file)?, &name)?;
        if !name.starts_with(UNSAFE_PACKAGE) {
            for line in lines_with(tokens, "unsafe") {
                findings.push(format!("{name}:{line}: unsafe outside {UNSAFE_PACKAGE}"));
            }
        }
    }
    for name in ["rust-toolchain", "rust-toolchain.toml"] {
        if workspace.root.join(name).exists() {
            let reason = "breaks every cargo call where what it lists cannot be fetched";
            findings.push(format!("{name}: {reason}"));
        }
    }
    let locks = WORKSPACES.map(|manifest| manifest.replace(".toml", ".lock"));
    let locks = locks.iter().map(String::as_str);
    for name in ["LICENSE-MIT", "LICENSE-APACHE", "README.md"]
        .into_iter()
        .chain(locks)
    {
        if !workspace.root.join(name).is_file() {
            findings.push(format!("{name} is missing"));
        }
    }
    // A lock file that cargo has to change, or that git does not keep, builds something else elsewhere.
    if process::output(workspace.cargo("metadata --locked --format-version 1")).is_none() {
        findings.push("Cargo.lock is stale (`cargo metadata --locked` says why)".into());
    }
    let sh = workspace.shell()?;
    let tracked = process::output(cmd!(sh, "git ls-files --error-unmatch Cargo.lock")).is_some();
    if workspace.root.join(".git").exists() && !tracked {
        findings.push("Cargo.lock is not committed".into());
    }
    passed_without(&findings, format!("{} files", files.len()))
}

/// The tokens of Rust source: no comment, and every text one token.
pub fn tokens(source: &str, name: &str) -> Result<TokenStream> {
    // A shebang or a byte order mark is no token; no file here has one.
    source.parse().map_err(|error| anyhow!("{name}: {error}"))
}

/// The lines on which an identifier stands.
fn lines_with(tokens: TokenStream, name: &str) -> Vec<usize> {
    let lines = tokens.into_iter().flat_map(|token| match token {
        TokenTree::Ident(ident) if ident == name => vec![ident.span().start().line],
        TokenTree::Group(group) => lines_with(group.stream(), name),
        _ => Vec::new(),
    });
    lines.collect()
}

/// Packages of the workspace, and the ones that they must not depend on, however indirectly, unless
/// an optional feature says so.
const ARROWS: [(&str, &[&str]); 6] = [
    (
        "fw-core",
        &[
            "host-link",
            "pilot",
            "navigator",
            "mapper",
            "twin",
            "plant",
            "fw-pac",
        ],
    ),
    (
        "host-link",
        &["pilot", "navigator", "mapper", "twin", "plant", "fw-pac"],
    ),
    (
        "mapper",
        &[
            "fw-core",
            "host-link",
            "pilot",
            "navigator",
            "twin",
            "plant",
        ],
    ),
    (
        "navigator",
        &["fw-core", "host-link", "pilot", "twin", "plant"],
    ),
    ("pilot", &["twin", "plant"]),
    (
        "twin",
        &["fw-core", "host-link", "pilot", "navigator", "mapper"],
    ),
];

/// The dependency arrows point one way; fw-core is the same code wherever it is built.
pub fn arrows(session: &Session) -> Result<Outcome> {
    let workspace = &session.workspace;
    let packages = workspace.packages("Cargo.toml")?;
    let mut findings = Vec::new();
    for (from, forbidden) in ARROWS {
        let reached = reachable(&packages, from);
        let wrong = forbidden.iter().filter(|name| reached.contains(**name));
        findings.extend(wrong.map(|name| format!("{from} depends on {name}")));
    }
    let core = packages
        .iter()
        .find(|package| text(&package["name"]) == "fw-core");
    let core = core.context("no package fw-core")?;
    let dependencies: Vec<_> = normal(core)
        .map(|dependency| text(&dependency["name"]))
        .collect();
    if dependencies != ["fixed"] {
        findings.push(format!(
            "fw-core depends on {}, not on fixed alone",
            dependencies.join(", ")
        ));
    }
    if core["features"]
        .as_object()
        .is_some_and(|features| !features.is_empty())
    {
        findings.push("fw-core has features".into());
    }
    for file in workspace.files("fw-core/src")? {
        let name = workspace.relative(&file).to_string();
        for condition in conditions(tokens(&workspace.read(&file)?, &name)?) {
            findings.push(format!("{name}: cfg({condition}) is neither test nor kani"));
        }
    }
    let resolved = |words: &str| -> Result<BTreeSet<String>> {
        let words = format!("tree --edges normal --prefix none --format {{p}}[{{f}}] {words}");
        let tree = process::output(workspace.cargo(&words)).with_context(|| words.clone())?;
        Ok(tree
            .lines()
            .map(|line| line.trim_end_matches(" (*)").to_owned())
            .collect())
    };
    let core = resolved("--package fw-core")?;
    let names: BTreeSet<_> = core.iter().map(|line| line.split(' ').next()).collect();
    let mut parts = Vec::new();
    for words in [
        "--package proofs".into(),
        format!("--package fw-pac --target {TARGET}"),
    ] {
        let mut part = resolved(&words)?;
        part.retain(|line| names.contains(&line.split(' ').next()));
        parts.push(part);
    }
    let differ: Vec<_> = parts[0].symmetric_difference(&parts[1]).cloned().collect();
    if !differ.is_empty() {
        findings.push(format!(
            "proofs and firmware build fw-core of other parts: {differ:?}"
        ));
    }
    passed_without(&findings, format!("{} packages", packages.len()))
}

/// The dependencies of a package that every build of it has.
fn normal(package: &Value) -> impl Iterator<Item = &Value> {
    let dependencies = list(&package["dependencies"]).iter();
    let default = default_features(package);
    dependencies.filter(move |dependency| {
        let optional = format!("dep:{}", text(&dependency["name"]));
        let always = dependency["optional"] == false || default.contains(&optional);
        dependency["kind"].is_null() && always
    })
}

/// The features that `default` brings, and what they bring.
fn default_features(package: &Value) -> BTreeSet<String> {
    let (mut all, mut next) = (BTreeSet::new(), vec!["default".to_owned()]);
    while let Some(feature) = next.pop() {
        next.extend(
            list(&package["features"][&feature])
                .iter()
                .map(|name| text(name).to_owned()),
        );
        all.insert(feature);
    }
    all
}

/// The names of all packages of the workspace that `from` depends on.
fn reachable(packages: &[Value], from: &str) -> BTreeSet<String> {
    let (mut all, mut next) = (BTreeSet::new(), vec![from.to_owned()]);
    while let Some(name) = next.pop() {
        for package in packages
            .iter()
            .filter(|package| text(&package["name"]) == name)
        {
            for dependency in normal(package) {
                let name = text(&dependency["name"]).to_owned();
                if all.insert(name.clone()) {
                    next.push(name);
                }
            }
        }
    }
    all
}

/// What the conditions of `cfg(…)`, `cfg_attr(…)` and `cfg!(…)` name besides `test` and `kani`.
fn conditions(tokens: TokenStream) -> Vec<String> {
    const ALLOWED: [&str; 5] = ["test", "kani", "not", "any", "all"];
    let mut found = Vec::new();
    let mut is_condition = false;
    for token in tokens {
        match token {
            TokenTree::Ident(ident) => is_condition = ident == "cfg" || ident == "cfg_attr",
            TokenTree::Group(group) if is_condition => {
                is_condition = false;
                idents(group.stream(), &mut found);
            }
            TokenTree::Group(group) => found.extend(conditions(group.stream())),
            _ => {}
        }
    }
    found.retain(|name| !ALLOWED.contains(&name.as_str()));
    found
}

/// The identifiers up to the comma that ends the condition of `cfg_attr`.
fn idents(condition: TokenStream, found: &mut Vec<String>) {
    for token in condition {
        match token {
            TokenTree::Ident(ident) => found.push(ident.to_string()),
            TokenTree::Group(group) => idents(group.stream(), found),
            TokenTree::Punct(punct) if punct.as_char() == ',' => break,
            _ => {}
        }
    }
}

/// Lines of Rust, lines of the longest file, words of the documents.
pub fn size(session: &Session) -> Result<Outcome> {
    let workspace = &session.workspace;
    let budget = Budget::read(workspace)?;
    let tables = budget
        .value("line_limit.exempt")?
        .as_array()
        .context("line_limit.exempt is no list")?;
    let (mut lines, mut longest, mut words) = (0, (0, String::new()), 0);
    for file in workspace.rust_files()? {
        let name = workspace.relative(&file).to_string();
        let count = workspace.read(&file)?.lines().count();
        lines += count;
        if !tables.iter().any(|table| table.as_str() == Some(&name)) {
            if count > 400 {
                println!("  {name}: {count} lines");
            }
            longest = longest.max((count, name));
        }
    }
    for file in workspace.files("docs")? {
        if file.extension().is_some_and(|ending| ending == "md") {
            words += workspace.read(&file)?.split_whitespace().count();
        }
    }
    let (file_lines, name) = longest;
    let figures = json!({"rust_lines": lines, "file_lines": file_lines, "docs_words": words});
    println!("  {lines} lines of Rust, {file_lines} in {name}, {words} words in docs/");
    check_bars(session, "size", figures)?;
    Ok(Passed(format!(
        "{lines} lines of Rust, {file_lines} in {name}, {words} words in docs/"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unsafe_is_found_in_code_alone() {
        let source = r##"
fn a<'x>(s: &'x str) { // unsafe
    let t = "unsafe \" unsafe"; /* unsafe /* unsafe */ unsafe */
    let r = r#"unsafe " unsafe"#; let c = '"'; let q = '\''; let b = b"unsafe";
    unsafe { work() }
    let not_unsafe = 1;
}
"##;
        assert_eq!(lines_with(source.parse().unwrap(), "unsafe"), [5]);
    }

    #[test]
    fn condition_other_than_test_is_named() {
        let source = "#[cfg(test)] mod a; #[cfg(not(kani))] mod b { #[cfg(feature = \"x\")] fn f() {} }
                      #[cfg_attr(test, derive(Debug))] struct C; fn g() { if cfg!(debug_assertions) {} }";
        assert_eq!(
            conditions(source.parse().unwrap()),
            ["feature", "debug_assertions"]
        );
    }
}
