//! Lists theorems (decided for all inputs) and sampled properties, one a line, tab-separated: kind,
//! group, area, name, number of harnesses, covers, tests, properties it needs. With `--harnesses`:
//! every Kani harness by the name that Kani gives it.

use proofs::property::Property;

fn main() {
    if std::env::args().any(|word| word == "--harnesses") {
        for name in proofs::properties().flat_map(Property::kani_names) {
            println!("{name}");
        }
        return;
    }
    println!("kind\tgroup\tarea\tproperty\tharnesses\tcovers\ttests\tneeds");
    for property in proofs::properties() {
        println!(
            "{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}",
            property.kind,
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
