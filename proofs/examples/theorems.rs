//! Lists the theorems, one a line, tab-separated: number, area, property, harnesses, covers, tests,
//! what it needs. The gates hold their floors against it.

fn main() {
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
