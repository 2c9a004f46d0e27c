//! The tables of a Markdown document.

const DOCUMENT: &str = include_str!("../../../docs/interfaces.md");

/// A row by the names of its columns.
#[derive(Clone, Debug)]
pub struct Row {
    columns: Vec<&'static str>,
    cells: Vec<&'static str>,
}

impl Row {
    /// A cell's text.
    pub fn get(&self, column: &str) -> &'static str {
        let at = self.columns.iter().position(|name| *name == column);
        self.cells[at.unwrap_or_else(|| panic!("no column {column} in {:?}", self.columns))]
    }

    /// A cell's number, `0x…` or decimal.
    pub fn number(&self, column: &str) -> u64 {
        number(self.get(column))
    }
}

/// `0x…` or decimal.
pub fn number(text: &str) -> u64 {
    let parsed = match text.strip_prefix("0x") {
        Some(digits) => u64::from_str_radix(digits, 16),
        None => text.parse(),
    };
    parsed.unwrap_or_else(|_| panic!("{text} is not a number"))
}

/// The text of a file of the repository.
pub fn file(path: &str) -> String {
    let path = format!("{}/../{path}", env!("CARGO_MANIFEST_DIR"));
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}"))
}

fn cells(line: &'static str) -> Vec<&'static str> {
    let inner = line.trim().strip_prefix('|');
    let inner = inner.and_then(|line| line.strip_suffix('|'));
    let inner = inner.unwrap_or_else(|| panic!("not a row: {line}"));
    inner.split('|').map(str::trim).collect()
}

/// The rows of all tables of `docs/interfaces.md` with these columns, in its order.
pub fn rows(columns: &[&str]) -> Vec<Row> {
    rows_of(DOCUMENT, columns)
}

/// As [`rows`]: each belongs to one of `items`.
pub fn rows_for<T>(columns: &[&str], items: impl IntoIterator<Item = T>) -> Vec<(Row, T)> {
    let (rows, items) = (rows(columns), Vec::from_iter(items));
    assert_eq!(rows.len(), items.len());
    rows.into_iter().zip(items).collect()
}

/// The rows of all tables of a document with these columns, in its order.
pub fn rows_of(document: &'static str, columns: &[&str]) -> Vec<Row> {
    let mut found = Vec::new();
    let mut head: Option<Vec<&str>> = None;
    for line in document.lines() {
        if !line.starts_with('|') {
            head = None;
            continue;
        }
        let cells = cells(line);
        let Some(columns_here) = &head else {
            head = Some(cells);
            continue;
        };
        assert_eq!(cells.len(), columns_here.len(), "{line}");
        let is_rule = cells.iter().all(|cell| cell.starts_with("---"));
        if columns_here == columns && !is_rule {
            found.push(Row {
                columns: columns_here.clone(),
                cells,
            });
        }
    }
    assert!(!found.is_empty(), "no table with the columns {columns:?}");
    found
}
