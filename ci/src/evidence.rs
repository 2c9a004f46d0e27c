//! What Kani found, and of which sources: `proofs/evidence.toml`, a line a harness.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use serde::Deserialize;

use crate::error::{Context, Result, ensure};
use crate::process::captures;
use crate::workspace::{Workspace, code_of};

const FILE: &str = "proofs/evidence.toml";

/// What Kani found of a harness.
#[derive(Clone, Debug, Deserialize)]
pub struct Verdict {
    /// What is wrong with it; empty where it is proven and every cover was reached.
    pub finding: String,
    /// Covers reached, and declared.
    pub covers: [u32; 2],
    pub seconds: f64,
    pub tools: String,
    /// Assertions of `proofs` that it cannot reach.
    #[serde(default)]
    pub unreached: BTreeSet<String>,
    /// [`Sources::hash`] when it was checked.
    pub sources: String,
}

/// Verdicts by harness.
pub type Verdicts = BTreeMap<String, Verdict>;

/// The figure of these harnesses of all that are `declared`, and those without a verdict; an error where one has a
/// finding.
pub fn judge<'n>(
    names: &[&'n str],
    declared: &[&str],
    verdicts: &Verdicts,
) -> Result<(String, Vec<&'n str>)> {
    let of = |name: &&'n str| Some((*name, verdicts.get(*name)?));
    let found: Vec<_> = names.iter().filter_map(of).collect();
    let bad = found.iter().filter(|(_, one)| !one.finding.is_empty());
    let mut findings: Vec<_> = bad
        .map(|(name, one)| format!("{name} {}", one.finding))
        .collect();
    findings.extend(dead_assertions(declared, verdicts));
    ensure!(findings.is_empty(), findings.join("; "));
    let covers: u32 = found.iter().map(|(_, verdict)| verdict.covers[0]).sum();
    let times = found.iter().map(|(name, verdict)| (verdict.seconds, name));
    let seconds: f64 = times.clone().map(|(seconds, _)| seconds).sum();
    let (proven, all) = (found.len(), names.len());
    let tools: BTreeSet<_> = found.iter().map(|(_, one)| one.tools.as_str()).collect();
    let tools = Vec::from_iter(tools).join(" and ");
    let mut figure =
        format!("{tools}: {proven} of {all} harnesses proven, {covers} covers, {seconds:.0} s");
    if let Some((seconds, name)) = times.max_by(|one, two| one.0.total_cmp(&two.0)) {
        write!(figure, ", the longest {name}, {seconds:.0} s")?;
    }
    let missing = names.iter().filter(|name| !verdicts.contains_key(**name));
    Ok((figure, missing.copied().collect()))
}

/// Assertions that no harness of a property reaches, of the properties with a verdict on each: one may fix inputs
/// so that an assertion is another's.
fn dead_assertions(declared: &[&str], verdicts: &Verdicts) -> BTreeSet<String> {
    let mut dead = BTreeMap::<_, Option<BTreeSet<String>>>::new();
    for name in declared {
        let property = name.split("::harness::").next();
        let own = verdicts.get(*name).map(|verdict| verdict.unreached.clone());
        let all = dead.entry(property).or_insert_with(|| own.clone());
        *all = all.take().zip(own).map(|(all, own)| &all & &own);
    }
    let dead = dead.into_values().flatten().flatten();
    dead.map(|assertion| format!("{assertion} is never reached"))
        .collect()
}

/// The verdicts on the present sources.
pub fn read(workspace: &Workspace) -> Result<Verdicts> {
    let sources = Sources::read(workspace)?;
    let text = workspace.sh.read_file(FILE)?;
    let mut verdicts: Verdicts = toml::from_str(&text).context(FILE)?;
    verdicts.retain(|name, verdict| verdict.sources == sources.hash(name));
    Ok(verdicts)
}

/// Writes verdicts on these sources: those before the run, for they may change during it.
pub fn write(workspace: &Workspace, verdicts: &Verdicts, sources: &Sources) -> Result<()> {
    let mut text = "# Written by `cargo xtask prove --evidence`.\n".to_owned();
    for (name, one) in verdicts {
        let (finding, covers, tools) = (&one.finding, one.covers, &one.tools);
        let (seconds, unreached, sources) = (one.seconds, &one.unreached, sources.hash(name));
        let unreached: Vec<_> = unreached.iter().collect();
        writeln!(
            text,
            "{name:?} = {{ finding = {finding:?}, covers = {covers:?}, seconds = {seconds:.1}, \
             tools = {tools:?}, unreached = {unreached:?}, sources = {sources:?} }}"
        )?;
    }
    Ok(workspace.sh.write_file(FILE, text)?)
}

/// The code of `fw-core` by top-level module, `fw_core::wire`, and of `proofs` by file, `pid`: without
/// comments, without tests at the end of a file or in files of their own.
pub struct Sources(BTreeMap<String, String>);

impl Sources {
    pub fn read(workspace: &Workspace) -> Result<Self> {
        let mut files = workspace.texts("fw-core/src", "rs")?;
        files.extend(workspace.texts("proofs/src", "rs")?);
        // What the core is built of.
        let lock = workspace.sh.read_file("Cargo.lock")?;
        let fixed = captures(&lock, r#"name = "fixed"\nversion = (.*)"#).concat();
        files.push(("fixed.lock".into(), fixed));
        Ok(Self::of(files))
    }

    fn of(files: Vec<(String, String)>) -> Self {
        let mut modules = BTreeMap::<_, String>::new();
        for (path, text) in files {
            let names: Vec<_> = path.split(['/', '.']).collect();
            let module = match names[..] {
                _ if path.contains("/tests") => continue,
                ["fw-core", _, module, ..] => format!("fw_core::{module}"),
                [.., file, _] => file.to_owned(),
                _ => continue,
            };
            *modules.entry(module).or_default() += &code_of(&text);
        }
        Self(modules)
    }

    /// The modules whose names stand before a `::` in a module.
    fn used_by(&self, module: &str) -> Vec<String> {
        // It draws values of types of every module.
        if module == "input" {
            return Vec::new();
        }
        let (mut used, mut before) = (Vec::new(), "");
        for part in self.0[module].split("::") {
            let is_no_name = |letter: char| !letter.is_alphanumeric() && letter != '_';
            let name = part.rsplit(is_no_name).next().unwrap_or_default();
            let of_core = before == "fw_core" || module.starts_with("fw_core::");
            let path = format!("{}{name}", if of_core { "fw_core::" } else { "" });
            if self.0.contains_key(&path) {
                used.push(path);
            }
            before = name;
        }
        used
    }

    /// FNV-1a over the words of what `area::file::property::harness::name` is about: its file, the
    /// modules that are used there, the modules that are used in those.
    fn hash(&self, harness: &str) -> String {
        let file = harness.rsplit("::").nth(3).unwrap_or_default().to_owned();
        let mut modules = vec!["fixed".to_owned(), file];
        modules.retain(|module| self.0.contains_key(module));
        let mut next = 0;
        while let Some(module) = modules.get(next) {
            for used in self.used_by(module) {
                if !modules.contains(&used) {
                    modules.push(used);
                }
            }
            next += 1;
        }
        modules.sort();
        let texts = modules.iter().map(|module| &self.0[module]);
        let bytes = texts.flat_map(|text| text.split_whitespace().flat_map(str::bytes));
        let step = |hash: u64, byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01B3);
        let hash = bytes.fold(0xCBF2_9CE4_8422_2325, step);
        format!("{hash:016x}")
    }
}

#[test]
fn verdict_holds_until_what_it_is_about_changes() {
    let hash = |changed: &str, addition: &str| {
        let files = [
            ("fw-core/src/wire/mod.rs", "use crate::types::Order;\n"),
            ("fw-core/src/wire/tests.rs", ""),
            ("fw-core/src/types.rs", "enum Order {}\n"),
            ("fw-core/src/robot.rs", "use crate::wire::Order;\n"),
            ("proofs/src/wire/link.rs", "use super::table::{Table};\n"),
            ("proofs/src/wire/table.rs", "use fw_core::wire::Order;\n"),
            ("proofs/src/input.rs", "use fw_core::robot::Robot;\n"),
            ("fixed.lock", "1.29"),
        ];
        let text = |path, text| text + if path == changed { addition } else { "" };
        let files = files.map(|(path, own)| (path.to_owned(), text(path, own.to_owned())));
        Sources::of(files.into()).hash("wire::link::property::harness::proof")
    };
    let same = hash("", "");
    for file in ["wire/mod.rs", "types.rs"] {
        let file = format!("fw-core/src/{file}");
        assert_ne!(hash(&file, "const A: u8 = 1;\n"), same, "{file}");
        assert_eq!(hash(&file, "    // A comment.\n\n"), same);
        assert_eq!(hash(&file, "\n#[cfg(test)]\nmod tests {\n}\n"), same);
    }
    for file in "fixed.lock proofs/src/wire/link.rs proofs/src/wire/table.rs".split(' ') {
        assert_ne!(hash(file, "1"), same, "{file}");
    }
    for file in "fw-core/src/robot.rs fw-core/src/wire/tests.rs proofs/src/input.rs".split(' ') {
        assert_eq!(hash(file, "const A: u8 = 1;\n"), same, "{file}");
    }
}

#[test]
fn assertion_is_dead_where_no_harness_of_its_property_reaches_it() {
    let one =
        r#"finding = "", covers = [1, 1], seconds = 1, tools = "", sources = "", unreached ="#;
    let verdicts = |b| {
        let text =
            format!("'p::harness::a' = {{ {one} ['x', 'y'] }}\n'p::harness::b' = {{ {one} {b} }}");
        toml::from_str::<Verdicts>(&text).unwrap()
    };
    let names = ["p::harness::a", "p::harness::b", "p::harness::c"];
    let dead = |b, names| Vec::from_iter(dead_assertions(names, &verdicts(b)));
    assert_eq!(dead("['y']", &names[..2]), ["y is never reached"]);
    assert!(dead("[]", &names[..2]).is_empty());
    // Another harness may reach it.
    assert!(dead("['y']", &names).is_empty());
}
