//! Tables in documents that are generated from the sources.

use crate::sources::{read, root};

/// Set to 1, it lets the tests write the tables instead of comparing them.
const UPDATE: &str = "FUYU_UPDATE_DOCS";

/// The items of one cell.
pub fn cell<T: AsRef<str>>(items: impl IntoIterator<Item = T>) -> String {
    let items: Vec<_> = items.into_iter().map(|i| i.as_ref().to_owned()).collect();
    items.join(", ")
}

/// Compares the table with this head in the file at `path`, whose lines begin with `prefix`, with `rows`; writes it
/// instead if the environment says so.
pub fn check_table<const N: usize>(
    path: &str,
    prefix: &str,
    head: &[&str; N],
    rows: &[[String; N]],
) {
    let line = |cells: &[String; N]| format!("{prefix}| {} |", cells.join(" | "));
    let mut expected = vec![
        line(&head.map(str::to_owned)),
        line(&[(); N].map(|()| "---".to_owned())),
    ];
    expected.extend(rows.iter().map(line));
    let text = read(path);
    let lines: Vec<_> = text.lines().collect();
    let first = format!("{prefix}| {} | {} |", head[0], head[1]);
    let start = lines
        .iter()
        .position(|l| l.starts_with(first.trim_end_matches('|')))
        .unwrap_or_else(|| panic!("{path}: has no table `{first}`"));
    let row = format!("{prefix}|");
    let count = lines[start..]
        .iter()
        .take_while(|l| l.starts_with(&row))
        .count();
    if lines[start..start + count] == expected {
        return;
    }
    if std::env::var(UPDATE).is_ok_and(|value| value == "1") {
        let after = lines[start + count..].iter().map(|&l| l.to_owned());
        let before = lines[..start].iter().map(|&l| l.to_owned());
        let all: Vec<String> = before.chain(expected).chain(after).collect();
        std::fs::write(root().join(path), all.join("\n") + "\n").expect("the table is written");
        return;
    }
    let is_new = |line: &&String| !lines.contains(&line.as_str());
    let new: Vec<_> = expected.iter().filter(is_new).collect();
    panic!(
        "{path}: the table `{first}` is not what the sources declare; run `{UPDATE}=1 cargo test --test house`, and \
         commit the result. Lines that differ: {new:#?}"
    );
}
