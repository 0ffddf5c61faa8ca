//! Text and numbers as HTML, SVG and CSV have them.

use std::borrow::Cow;
use std::fmt::Write;

/// Text that stands for itself in HTML and SVG, between tags and in quoted values alike.
///
/// Characters that XML cannot hold (a file's name may have them) become U+FFFD.
pub(crate) fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            '\t' | '\n' => safe.push(character),
            '\0'..='\u{1f}' | '\u{7f}'..='\u{9f}' | '\u{fffe}' | '\u{ffff}' => safe.push('\u{fffd}'),
            _ => safe.push(character),
        }
    }
    safe
}

/// A place in a picture, to a hundredth of a pixel.
pub(super) fn px(value: f64) -> String {
    let text = format!("{value:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_string() } else { text.to_string() }
}

/// A share in percent, as sentences have it: `24 %`.
pub(super) fn percent(share: f64) -> String {
    // A no-break space: the sign never stands alone on a line.
    format!("{:.0}\u{a0}%", 100.0 * share)
}

/// A path of straight lines through places, shape `(n, 2)`, pixels. Places equal to the one before are left out.
pub(super) fn polyline(places: impl IntoIterator<Item = (f64, f64)>) -> String {
    let (mut path, mut last) = (String::new(), None);
    for (x, y) in places {
        let place = (px(x), px(y));
        if last.as_ref() != Some(&place) {
            path.push(if last.is_none() { 'M' } else { 'L' });
            path.push_str(&place.0);
            path.push(' ');
            path.push_str(&place.1);
            last = Some(place);
        }
    }
    path
}

/// A table of comma-separated values, RFC 4180 but for the line ends.
#[derive(Clone, Debug)]
pub(super) struct Csv(String);

impl Csv {
    /// * `titles` — of the columns, with units
    pub(super) fn new(titles: &[&str]) -> Self {
        Self(titles.join(",") + "\n")
    }

    /// Adds a line: `cells!["Isomap", 3, 0.5]`-like displays, in the order of the titles.
    pub(super) fn line(&mut self, cells: &[&dyn std::fmt::Display]) {
        for (index, cell) in cells.iter().enumerate() {
            let comma = if index == 0 { "" } else { "," };
            write!(self.0, "{comma}{}", quoted(&cell.to_string()))
                .expect("a string takes all that is written");
        }
        self.0.push('\n');
    }

    pub(super) fn into_text(self) -> String {
        self.0
    }
}

fn quoted(cell: &str) -> Cow<'_, str> {
    match cell.contains([',', '"', '\n', '\r']) {
        true => Cow::Owned(format!("\"{}\"", cell.replace('"', "\"\""))),
        false => Cow::Borrowed(cell),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escaped_text_reads_back_as_it_was_between_tags_and_in_values() {
        for text in [
            "a < b && c > d",
            "\"quoted\" and 'quoted'",
            "</svg><script>",
            "κ = 0.76 · 10³",
            "tab\tnewline\n",
        ] {
            let markup = format!("<t v=\"{}\">{}</t>", escaped(text), escaped(text));
            let read = roxmltree::Document::parse(&markup).unwrap();
            assert_eq!(read.root_element().text(), Some(text));
            // XML itself turns white space in values into spaces.
            assert_eq!(read.root_element().attribute("v").unwrap(), text.replace(['\t', '\n'], " "));
        }
    }

    #[test]
    fn characters_that_xml_cannot_hold_are_replaced() {
        let markup = format!("<t>{}</t>", escaped("trip\u{0}\u{1b}[1m\u{ffff}.mcap"));
        assert_eq!(
            roxmltree::Document::parse(&markup).unwrap().root_element().text(),
            Some("trip\u{fffd}\u{fffd}[1m\u{fffd}.mcap")
        );
    }

    #[test]
    fn places_have_at_most_two_decimals_and_no_negative_zero() {
        assert_eq!([px(1.0), px(1.005001), px(-0.001), px(-2.5)], ["1", "1.01", "0", "-2.5"]);
        assert_eq!(polyline([(0.0, 0.0), (0.001, 0.0), (3.0, 4.5)]), "M0 0L3 4.5");
    }

    #[test]
    fn cells_with_commas_quotes_or_line_ends_are_quoted() {
        let mut csv = Csv::new(&["trip", "x_m"]);
        csv.line(&[&"first, \"best\"", &0.1]);
        assert_eq!(csv.into_text(), "trip,x_m\n\"first, \"\"best\"\"\",0.1\n");
    }
}
