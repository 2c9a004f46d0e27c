//! Puts all mutants of a crate into one program, to be switched on one by one: a build for all instead of
//! one for each.
//!
//! `switched LIST WORKSPACE CRATE [SKIPPED…]` reads what `cargo mutants --list --json` said, rewrites the
//! sources below WORKSPACE, and prints the numbers of the mutants it could put in, counted from 1 as they
//! stand in the list. The variable `MUTANT` of a program built from it says which one is on. Every line
//! that was rewritten carries `/*~NUMBER*/` of what was put in, so that a compiler's error can be laid to a
//! mutant; SKIPPED leaves those out.
//!
//! Mutants of constants are not put in, nor those of fields and inside of macros.
#![forbid(unsafe_code)]

mod edits;
mod visitor;

use std::collections::{BTreeMap, HashMap, HashSet};
use std::error::Error;
use std::path::Path;

use syn::visit::Visit;
use tinyjson::JsonValue;

use visitor::{Mutant, Mutants, Visitor};

/// What the crate is given to ask which mutant is on.
const SWITCH: &str = include_str!("switch.in.rs");

/// What the switch needs of the compiler: a function that reads the environment when it runs, and nothing
/// when it is calculated by the compiler.
const FEATURES: &str =
    "\n#![feature(core_intrinsics, const_eval_select)]\n#![allow(internal_features, warnings)]\n";

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [list, workspace, root, skipped @ ..] = &words[..] else {
        return Err("switched LIST WORKSPACE CRATE [SKIPPED…]".into());
    };
    let skipped: HashSet<usize> = skipped
        .iter()
        .map(|word| word.parse())
        .collect::<Result<_, _>>()?;
    let list: JsonValue = std::fs::read_to_string(list)?.parse()?;
    let workspace = Path::new(workspace);
    let mut put_in = Vec::new();
    for (file, mutants) in by_file(&list, &skipped)? {
        let path = workspace.join(file);
        let text = std::fs::read_to_string(&path)?;
        let mut visitor = Visitor::new(&text, &mutants);
        visitor.visit_file(&syn::parse_file(&text)?);
        std::fs::write(&path, visitor.edits.applied(&text))?;
        put_in.extend(visitor.put_in);
    }
    let path = workspace.join(root).join("src/lib.rs");
    let text = std::fs::read_to_string(&path)?;
    let text = text.replacen("#![no_std]", &("#![no_std]".to_owned() + FEATURES), 1);
    std::fs::write(&path, text + SWITCH)?;
    put_in.sort_unstable();
    for number in put_in {
        println!("{number}");
    }
    Ok(())
}

/// The mutants of each file, by the line and column of what they change.
fn by_file(
    list: &JsonValue,
    skipped: &HashSet<usize>,
) -> Result<BTreeMap<String, Mutants>, Box<dyn Error>> {
    let mut files = BTreeMap::<String, Mutants>::new();
    let list: &Vec<JsonValue> = list.get().ok_or("the list is no list")?;
    for (at, mutant) in list.iter().enumerate() {
        let number = at + 1;
        if skipped.contains(&number) {
            continue;
        }
        let text = |key: &str| -> Result<String, Box<dyn Error>> {
            let value = object(mutant).and_then(|mutant| mutant.get(key)?.get::<String>());
            Ok(value
                .ok_or_else(|| format!("a mutant without {key}"))?
                .clone())
        };
        let start = object(mutant).and_then(|mutant| object(mutant.get("span")?)?.get("start"));
        let coordinate = |key: &str| -> Result<usize, Box<dyn Error>> {
            let value = start.and_then(|start| object(start)?.get(key)?.get::<f64>());
            // Written as whole numbers.
            Ok(value
                .ok_or("a mutant without a place")?
                .to_string()
                .parse()?)
        };
        let place = (coordinate("line")?, coordinate("column")?);
        let mutants = files.entry(text("file")?).or_default();
        mutants.entry(place).or_default().push(Mutant {
            number,
            genre: text("genre")?,
            replacement: text("replacement")?,
        });
    }
    Ok(files)
}

fn object(value: &JsonValue) -> Option<&HashMap<String, JsonValue>> {
    value.get()
}
