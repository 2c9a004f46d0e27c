//! The gate on modules: every Rust file belongs to some crate, and the top-level modules of a crate
//! use each other in one direction only.

use std::collections::{BTreeMap, BTreeSet, HashSet, VecDeque};
use std::path::{Path, PathBuf};

use proc_macro2::{TokenStream, TokenTree};

use super::passed_without;
use super::source::WORKSPACES;
use super::structure::tokens;
use super::Outcome;
use crate::error::Result;
use crate::session::Session;
use crate::workspace::{list, text, Workspace};

pub fn gate(session: &Session) -> Result<Outcome> {
    let workspace = &session.workspace;
    let mut findings = Vec::new();
    let mut compiled = HashSet::new();
    let mut crates = 0;
    for manifest in WORKSPACES {
        for package in workspace.packages(manifest)? {
            for target in list(&package["targets"]) {
                let root = PathBuf::from(text(&target["src_path"]));
                let found = Crate::read(workspace, &root)?;
                let cycles = found.cycles().into_iter();
                let name = workspace.relative(&root);
                findings.extend(cycles.map(|cycle| format!("{name}: cycle {cycle}")));
                compiled.extend(found.files);
                crates += 1;
            }
        }
    }
    let files = workspace.rust_files()?;
    let unused = files.iter().filter(|file| !compiled.contains(*file));
    findings
        .extend(unused.map(|file| format!("{}: no crate compiles it", workspace.relative(file))));
    passed_without(
        &findings,
        format!("{} files of {crates} crates, no cycle", files.len()),
    )
}

/// What the source of a crate says of its modules.
#[derive(Default)]
struct Crate {
    files: HashSet<PathBuf>,
    /// The top-level modules, each with those that it uses outside of its tests.
    uses: BTreeMap<String, BTreeSet<String>>,
    /// The paths from the crate's root that each top-level module names, by their first word.
    paths: Vec<(String, String)>,
    /// What the root re-exports, with the module that it comes from.
    exports: BTreeMap<String, String>,
}

impl Crate {
    fn read(workspace: &Workspace, root: &Path) -> Result<Self> {
        let mut found = Self::default();
        let folder = root.parent().unwrap_or(Path::new("")).to_path_buf();
        found.file(workspace, root, &folder, &[])?;
        for (module, name) in std::mem::take(&mut found.paths) {
            let used = found.exports.get(&name).unwrap_or(&name).clone();
            if used != module && found.uses.contains_key(&used) {
                found.uses.entry(module).or_default().insert(used);
            }
        }
        Ok(found)
    }

    /// A module in a file of its own; its modules' files are in `folder`. An empty `path` is the root,
    /// one that begins with an empty name a test.
    fn file(
        &mut self,
        workspace: &Workspace,
        file: &Path,
        folder: &Path,
        path: &[String],
    ) -> Result<()> {
        if !self.files.insert(file.to_path_buf()) {
            return Ok(());
        }
        let name = workspace.relative(file).to_string();
        let tokens = tokens(&workspace.read(file)?, &name)?;
        if path.is_empty() {
            self.exports(tokens.clone());
        }
        self.tokens(workspace, tokens, file, folder, path)
    }

    fn tokens(
        &mut self,
        workspace: &Workspace,
        tokens: TokenStream,
        file: &Path,
        folder: &Path,
        path: &[String],
    ) -> Result<()> {
        let tokens: Vec<_> = tokens.into_iter().collect();
        let mut attributes = String::new();
        let mut at = 0;
        while at < tokens.len() {
            let rest = &tokens[at..];
            at += 1;
            match rest {
                [TokenTree::Punct(hash), TokenTree::Group(attribute), ..]
                    if hash.as_char() == '#' =>
                {
                    attributes += &attribute.stream().to_string();
                    at += 1;
                }
                [TokenTree::Ident(word), TokenTree::Ident(name), body, ..] if word == "mod" => {
                    let mut inner = path.to_vec();
                    // Tests may use what they test.
                    inner.push(
                        if attributes.contains("cfg (test)") || attributes.contains("cfg(test)") {
                            String::new()
                        } else {
                            name.to_string()
                        },
                    );
                    if let [one] = &inner[..] {
                        self.uses.entry(one.clone()).or_default();
                    }
                    let folder_of = folder.join(name.to_string());
                    if let TokenTree::Group(body) = body {
                        self.tokens(workspace, body.stream(), file, &folder_of, &inner)?;
                    } else {
                        let own = attributes.split_once("path = \"");
                        let own = own.and_then(|(_, path)| path.split_once('"'));
                        let beside = folder.join(format!("{name}.rs"));
                        let at = match own {
                            Some((own, _)) => file.parent().unwrap_or(folder).join(own),
                            None if beside.is_file() => beside,
                            None => folder_of.join("mod.rs"),
                        };
                        self.file(workspace, &at, &folder_of, &inner)?;
                    }
                    attributes.clear();
                    at += 2;
                }
                [TokenTree::Ident(word), TokenTree::Punct(bang), TokenTree::Group(argument), ..]
                    if bang.as_char() == '!' && word.to_string().starts_with("include") =>
                {
                    let included = argument.stream().to_string();
                    let included = file
                        .parent()
                        .unwrap_or(folder)
                        .join(included.trim_matches('"'));
                    self.files.insert(included);
                }
                [TokenTree::Ident(word), ..] if word == "crate" || word == "super" => {
                    self.path(rest, path);
                    attributes.clear();
                }
                [TokenTree::Group(group), ..] => {
                    self.tokens(workspace, group.stream(), file, folder, path)?;
                    attributes.clear();
                }
                [TokenTree::Ident(word), ..] if word != "pub" => attributes.clear(),
                _ => {}
            }
        }
        Ok(())
    }

    /// `crate::a::…`, `super::{a, b::…}`: notes the words after the root.
    fn path(&mut self, tokens: &[TokenTree], path: &[String]) {
        let mut depth = path.len();
        let mut rest = tokens;
        while let [TokenTree::Ident(word), TokenTree::Punct(_), TokenTree::Punct(_), after @ ..] =
            rest
        {
            match word.to_string().as_str() {
                "crate" => depth = 0,
                "super" => depth = depth.saturating_sub(1),
                _ => break,
            }
            rest = after;
        }
        let is_test = path.iter().any(String::is_empty);
        let (Some(module), false, 0) = (path.first(), is_test, depth) else {
            return;
        };
        let names = match rest {
            [TokenTree::Ident(name), ..] => vec![name.to_string()],
            [TokenTree::Group(group), ..] => leaves(group.stream(), true),
            _ => Vec::new(),
        };
        self.paths
            .extend(names.into_iter().map(|name| (module.clone(), name)));
    }

    /// `use a::{b, c::D as E};` in the root: `b` and `E` are exported from `a`.
    fn exports(&mut self, tokens: TokenStream) {
        let mut item: Option<Vec<TokenTree>> = None;
        for token in tokens {
            match (&mut item, token) {
                (None, TokenTree::Ident(word)) if word == "use" => item = Some(Vec::new()),
                (Some(tokens), TokenTree::Punct(end)) if end.as_char() == ';' => {
                    tokens.retain(|token| !matches!(token, TokenTree::Ident(word) if word == "self" || word == "crate"));
                    let module = tokens.iter().find_map(|token| match token {
                        TokenTree::Ident(module) => Some(module.to_string()),
                        _ => None,
                    });
                    let names = leaves(tokens.drain(..).collect(), false);
                    let module = module.unwrap_or_default();
                    self.exports
                        .extend(names.into_iter().map(|name| (name, module.clone())));
                    item = None;
                }
                (Some(tokens), token) => tokens.push(token),
                (None, _) => {}
            }
        }
        self.exports.retain(|name, module| name != module);
    }

    /// Ways from a module back to itself, none of which shares a module with another.
    fn cycles(&self) -> Vec<String> {
        let mut cycles = Vec::new();
        let mut reported = HashSet::new();
        for start in self.uses.keys() {
            let way = self.way_back(start);
            if !way.is_empty() && way.iter().all(|module| reported.insert(*module)) {
                cycles.push(format!("{} → {start}", way.join(" → ")));
            }
        }
        cycles
    }

    /// A shortest way from a module back to itself, without its end; empty where there is none.
    fn way_back<'a>(&'a self, start: &'a str) -> Vec<&'a str> {
        let mut ways = VecDeque::from([vec![start]]);
        let mut seen = HashSet::new();
        while let Some(way) = ways.pop_front() {
            let used = way.last().and_then(|last| self.uses.get(*last));
            for next in used.into_iter().flatten() {
                if next == start {
                    return way;
                }
                if seen.insert(next) {
                    ways.push_back([&way[..], &[next]].concat());
                }
            }
        }
        Vec::new()
    }
}

/// Of `a::b, c::{d, e as f}` the first words, `a` and `c`, or the last ones, `b`, `d` and `f`.
fn leaves(tokens: TokenStream, first: bool) -> Vec<String> {
    let (mut names, mut current) = (Vec::new(), None);
    for token in tokens {
        match token {
            TokenTree::Punct(comma) if comma.as_char() == ',' => names.extend(current.take()),
            TokenTree::Ident(word) if !first || current.is_none() => {
                current = Some(word.to_string());
            }
            TokenTree::Group(group) if !first => {
                current = None;
                names.extend(leaves(group.stream(), first));
            }
            _ => {}
        }
    }
    names.extend(current);
    names
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::workspace::Workspace;

    fn cycles(files: &[(&str, &str)]) -> (Vec<String>, usize) {
        let mut workspace = Workspace::find().unwrap();
        let number = files.iter().map(|(_, text)| text.len()).sum::<usize>();
        workspace.root =
            std::env::temp_dir().join(format!("modules-{}-{number}", std::process::id()));
        for (name, text) in files {
            let file = workspace.root.join(name);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            std::fs::write(file, text).unwrap();
        }
        let found = Crate::read(&workspace, &workspace.root.join("lib.rs")).unwrap();
        std::fs::remove_dir_all(&workspace.root).unwrap();
        (found.cycles(), found.files.len())
    }

    #[test]
    fn cycle_between_modules_is_found_in_every_notation() {
        let root = ("lib.rs", "mod a; mod b;\npub use b::{deep::B, C as D};\n");
        let b = ("b/mod.rs", "mod deep; fn f() { crate::a::g() }");
        let deep = ("b/deep.rs", "use super::C; use crate::b::D; struct B;");
        for a in [
            "use crate::b;",
            "use super::{x::Y, b::Z};",
            "fn f() { crate::b::g() }",
            "use crate::{B};",
            "mod c { use super::super::D; }",
        ] {
            let found = cycles(&[root, ("a.rs", a), b, deep]);
            assert_eq!(found, (vec!["a → b → a".to_owned()], 4), "{a}");
        }
        for a in [
            "use crate::a::c; use super::C;",
            "#[cfg(test)]\nmod tests { use crate::b::C; }",
            "/// See [`crate::b`].\nstruct S;",
            "mod b { pub struct X; } use self::b::X;",
        ] {
            assert_eq!(cycles(&[root, ("a.rs", a), b, deep]), (vec![], 4), "{a}");
        }
    }
}
