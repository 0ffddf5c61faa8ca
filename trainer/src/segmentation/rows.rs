//! The two ways to write a segmentation down, as rows.

use serde::Deserialize;

use super::{SegmentFormat, SegmentationError};

/// An interval as it is written, and where.
#[derive(Debug)]
pub(super) struct Row {
    /// `line 3` of a table, `interval 3` of a list.
    pub(super) place: String,
    /// Empty if none is named.
    pub(super) trip: String,
    pub(super) from_s: f64,
    pub(super) to_s: f64,
    pub(super) name: String,
}

/// An interval of a list.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    #[serde(default)]
    trip: String,
    from_s: f64,
    to_s: f64,
    name: String,
}

/// Titles of a table; only the first may be left out.
const TITLES: [&str; 4] = ["trip", "from_s", "to_s", "name"];

pub(super) fn rows(text: &str, format: SegmentFormat) -> Result<Vec<Row>, SegmentationError> {
    // Spreadsheets begin their files with a mark.
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    match format {
        // The reader counts a line that ends in both as ended after the first of them.
        SegmentFormat::Csv => of_csv(&text.replace("\r\n", "\n")),
        SegmentFormat::Ron => of_ron(text),
    }
}

fn of_csv(text: &str) -> Result<Vec<Row>, SegmentationError> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    let titles = reader.headers().map_err(|error| of_table(&error))?.clone();
    if titles.is_empty() {
        return Ok(Vec::new());
    }
    let columns = columns(&titles)?;
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| of_table(&error))?;
        let line = record.position().map_or(0, csv::Position::line);
        let [trip, from_s, to_s, name] = columns.map(|column| column.map_or("", |column| &record[column]));
        let seconds = |title: &str, cell: &str| {
            let message = || format!("{title} is \"{cell}\"; it must be a number of seconds");
            cell.parse().map_err(|_| SegmentationError::Csv { line, message: message() })
        };
        rows.push(Row {
            place: format!("line {line}"),
            trip: trip.to_string(),
            from_s: seconds("from_s", from_s)?,
            to_s: seconds("to_s", to_s)?,
            name: name.to_string(),
        });
    }
    Ok(rows)
}

/// In which column each of [`TITLES`] stands.
fn columns(titles: &csv::StringRecord) -> Result<[Option<usize>; 4], SegmentationError> {
    let wrong = |what: String| {
        let message = format!("{what}; the titles must be trip (which may be left out), from_s, to_s, name");
        SegmentationError::Csv { line: 1, message }
    };
    if let Some(unknown) = titles.iter().find(|title| !TITLES.contains(title)) {
        return Err(wrong(format!("there is a column {unknown}")));
    }
    let columns = TITLES.map(|title| titles.iter().position(|found| found == title));
    match (1..TITLES.len()).find(|index| columns[*index].is_none()) {
        Some(missing) => Err(wrong(format!("there is no column {}", TITLES[missing]))),
        None => Ok(columns),
    }
}

/// What is wrong with a table as such.
fn of_table(error: &csv::Error) -> SegmentationError {
    let line = error.position().map_or(1, csv::Position::line);
    let message = match error.kind() {
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => format!(
            "the row has {len} cells and there are {expected_len} titles; put names with commas in quotation marks"
        ),
        _ => error.to_string(),
    };
    SegmentationError::Csv { line, message }
}

fn of_ron(text: &str) -> Result<Vec<Row>, SegmentationError> {
    let written: Vec<Written> = ron::from_str(text).map_err(|error| SegmentationError::Ron {
        line: error.span.start.line,
        column: error.span.start.col,
        message: error.code.to_string(),
    })?;
    let row = |(Written { trip, from_s, to_s, name }, number): (Written, usize)| Row {
        place: format!("interval {number}"),
        trip: trip.trim().to_string(),
        from_s,
        to_s,
        name: name.trim().to_string(),
    };
    Ok(written.into_iter().zip(1..).map(row).collect())
}
