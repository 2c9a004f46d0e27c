//! Lists the theorems, one a line, tab-separated: number, area, property, harnesses, covers, tests,
//! what it needs; or, with `--harnesses`, every Kani harness by the name that Kani gives it. The gates
//! hold their floors against the one and what was checked against the other.

use proofs::theorem::Theorem;

fn main() {
    if std::env::args().any(|word| word == "--harnesses") {
        for name in proofs::theorems().flat_map(Theorem::kani_names) {
            println!("{name}");
        }
        return;
    }
    println!("theorem\tarea\tproperty\tharnesses\tcovers\ttests\tneeds");
    for theorem in proofs::theorems() {
        println!(
            "{}\t{}\t{}\t{}\t{}\t{}\t{}",
            theorem.number,
            theorem.area,
            theorem.name,
            theorem.harnesses.len(),
            theorem.harnesses.len() * theorem.cases.len(),
            theorem.tests.join(","),
            theorem.needs.join(","),
        );
    }
}
