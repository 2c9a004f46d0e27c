//! The gate on modules: every Rust file belongs to some crate, and the top-level modules of a crate
//! use each other in one direction only. It reads source as rustfmt leaves it.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::Path;

use super::passed_without;
use crate::error::Result;
use crate::process::pattern;
use crate::session::Session;
use crate::workspace::{code_of, list, text};

/// Source texts by path.
type Files = BTreeMap<String, String>;

pub fn gate(session: &Session) -> Result<String> {
    let files: Files = session.texts("", "rs")?.into_iter().collect();
    let (mut findings, mut compiled, mut crates) = (Vec::new(), HashSet::new(), 0);
    for package in session.packages()? {
        for target in list(&package["targets"]) {
            let root = Path::new(text(&target["src_path"]));
            let root = session.relative(root).to_string();
            let found = Modules::read(&files, &root);
            let cycle = found.cycle();
            if !cycle.is_empty() {
                findings.push(format!("{root}: cycle of {cycle:?}"));
            }
            compiled.extend(found.files);
            crates += 1;
        }
    }
    let unused = files.keys().filter(|file| !compiled.contains(*file));
    findings.extend(unused.map(|file| format!("{file}: no crate compiles it")));
    let figure = format!("{} files of {crates} crates, no cycle", files.len());
    passed_without(&findings, figure)
}

/// The modules of one crate.
#[derive(Default)]
struct Modules {
    files: HashSet<String>,
    /// The top-level modules, each with the words that follow the root in its paths outside of tests.
    uses: BTreeMap<String, BTreeSet<String>>,
}

impl Modules {
    fn read(files: &Files, root: &str) -> Self {
        let mut found = Self::default();
        let folder = root.rsplit_once('/').map_or("", |(folder, _)| folder);
        found.file(files, root, folder, &[]);
        // What the root re-exports is used from the module that it comes from.
        let source = files.get(root).map_or("", String::as_str);
        let export =
            pattern(r"(?m)^(?:pub(?:\(crate\))? )?use (?:(?:crate|self)::)?(\w+)::([^;]*);");
        let name = pattern(r"(\w+)\s*(?:[,}]|$)");
        for export in export.captures_iter(source) {
            for name in name.captures_iter(&export[2]) {
                let users = found.uses.values_mut();
                for used in users.filter(|used| used.contains(&name[1])) {
                    used.insert(export[1].to_owned());
                }
            }
        }
        found
    }

    /// A module in a file of its own; the files of its modules are in `folder`.
    fn file(&mut self, files: &Files, file: &str, folder: &str, path: &[&str]) {
        let Some(source) = files.get(file) else {
            return;
        };
        self.files.insert(file.to_owned());
        if let Some((module, _)) = path.split_first() {
            let used = self.uses.entry((*module).to_owned()).or_default();
            used.extend(paths(source, path.len()));
        }
        let beside = file.rsplit_once('/').map_or("", |(beside, _)| beside);
        let included = pattern(r#"include(?:_str)?!\("(.*\.rs)"\)"#);
        let included = included.captures_iter(source);
        let included = included.map(|file| format!("{beside}/{}", &file[1]));
        self.files.extend(included);
        let item = r"(?m)^((?: *#\[.*\]\n)*) *(?:pub(?:\(\w+\))? )?mod (\w+);";
        for declared in pattern(item).captures_iter(source) {
            let (attributes, name) = (&declared[1], &declared[2]);
            let below = format!("{folder}/{name}");
            let own = pattern(r#"path = "(.*)""#).captures(attributes);
            let own = own.map(|own| format!("{beside}/{}", &own[1])).into_iter();
            let candidates = own.chain([".rs", "/mod.rs"].map(|end| format!("{below}{end}")));
            if attributes.contains("cfg(test)") {
                let mut tests = Self::default();
                candidates.for_each(|own| tests.file(files, &own, &below, &[]));
                self.files.extend(tests.files);
            } else {
                let path = [path, &[name]].concat();
                candidates.for_each(|own| self.file(files, &own, &below, &path));
            }
        }
    }

    /// The modules that are part of a cycle, or on a way from one to another.
    fn cycle(&self) -> BTreeSet<&String> {
        let uses = |one: &String, two: &String| one != two && self.uses[one].contains(two);
        let mut left: BTreeSet<_> = self.uses.keys().collect();
        loop {
            let all = left.clone();
            left.retain(|module| all.iter().any(|other| uses(other, module)));
            left.retain(|module| all.iter().any(|other| uses(module, other)));
            if left == all {
                return left;
            }
        }
    }
}

/// The words that follow the crate's root in paths, `a` in `crate::a::B`, `a` and `c` in
/// `super::{a::B, c}` of a module of `depth` 1; without the tests at the end of the file.
fn paths(source: &str, depth: usize) -> BTreeSet<String> {
    let inner = pattern(r"\{[^{}]*\}");
    let root = format!(
        r"(?:^|[^\w$:])(?:crate::|(?:super::){{{depth}}})(\w+|\{{(?:[^{{}};]|\{{[^{{}}]*\}})*\}})"
    );
    let first = pattern(r"(?:^|,)\s*(\w+)");
    let mut names = BTreeSet::new();
    for path in pattern(&root).captures_iter(&code_of(source)) {
        let group = path[1].trim_start_matches('{').trim_end_matches('}');
        let group = inner.replace_all(group, "");
        names.extend(first.captures_iter(&group).map(|name| name[1].to_owned()));
    }
    names
}

#[test]
fn cycle_is_found_in_every_notation_outside_tests_and_comments() {
    for (a, is_cycle) in [
        ("use crate::b;\n", true),
        ("use super::{\n    x::Y,\n    b::Z,\n};\n", true),
        ("fn f() {\n    crate::b::g()\n}\n", true),
        ("use crate::{x::{Y, Z}, B};\n", true),
        ("use super::D;\n", true),
        ("use crate::a::c;\nuse super::C;\n", false),
        (
            "\n#[cfg(test)]\nmod tests {\n    use crate::b::C;\n}",
            false,
        ),
        ("/// See [`crate::b`].\nstruct S;\n", false),
    ] {
        let root = "mod a;\nmod b;\npub use b::{deep::B, C as D};\n";
        let deep = "use super::C;\nuse crate::b::D;\nconst E: &str = include_str!(\"e.in.rs\");\n";
        let b = "mod deep;\nfn f() {\n    crate::a::g()\n}\n";
        let files = [
            ("lib.rs", root),
            ("a.rs", a),
            ("b/mod.rs", b),
            ("b/deep.rs", deep),
        ];
        let files = files.map(|(name, text)| (format!("src/{name}"), text.to_owned()));
        let found = Modules::read(&files.into(), "src/lib.rs");
        let expected: &[&str] = if is_cycle { &["a", "b"] } else { &[] };
        assert!(found.cycle().into_iter().eq(expected), "{a}");
        assert_eq!(found.files.len(), 5);
    }
}
