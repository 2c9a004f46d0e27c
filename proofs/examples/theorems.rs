//! Lists the theorems, one a line, tab-separated: number, area, property, harnesses, covers, tests,
//! what it needs; or, with `--harnesses`, every Kani harness by the name that Kani gives it. The gates
//! hold their floors against the one and what was checked against the other.

use proofs::property::Property;

fn main() {
    if std::env::args().any(|word| word == "--harnesses") {
        for name in proofs::properties().flat_map(Property::kani_names) {
            println!("{name}");
        }
        return;
    }
    println!("theorem\tarea\tproperty\tharnesses\tcovers\ttests\tneeds");
    for property in proofs::properties() {
        println!(
            "{}\t{}\t{}\t{}\t{}\t{}\t{}",
            property.number,
            property.area,
            property.name,
            property.harnesses.len(),
            property.harnesses.len() * property.cases.len(),
            property.tests.join(","),
            property.needs.join(","),
        );
    }
}
