//! The page: headings, paragraphs, tables and figures, one after the other, as one file of HTML.

use super::figure::Figure;
use super::markup::escaped;
use super::theme;

/// A report that a person opens: one file without network or script, for screens wide and narrow, light and dark, and
/// for paper.
#[derive(Clone, Debug)]
pub struct Page {
    title: String,
    headings: Vec<String>,
    body: String,
    figures: Vec<Figure>,
    attached: Vec<ReportFile>,
}

/// A table of text and numbers.
#[derive(Clone, Debug)]
pub struct Table {
    columns: Vec<Column>,
    rows: Vec<Vec<String>>,
}

/// A column of a table.
#[derive(Clone, Debug)]
pub struct Column {
    title: String,
    is_number: bool,
}

/// A file of a report.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReportFile {
    /// Its name, without folder.
    pub name: String,
    /// What is in it.
    pub contents: String,
}

impl Column {
    /// Text: words from the left.
    pub fn text(title: &str) -> Self {
        Self { title: title.to_string(), is_number: false }
    }

    /// Numbers, already in words and with units: they stand to the right, below each other.
    pub fn number(title: &str) -> Self {
        Self { title: title.to_string(), is_number: true }
    }

    fn class(&self) -> &'static str {
        if self.is_number { " class=\"number\"" } else { "" }
    }
}

impl Table {
    /// A table without rows.
    pub fn new(columns: Vec<Column>) -> Self {
        Self { columns, rows: Vec::new() }
    }

    /// Adds a row.
    ///
    /// # Panics
    /// If it has not one cell for each column: a bug of the caller.
    pub fn row(&mut self, cells: Vec<String>) {
        assert_eq!(cells.len(), self.columns.len(), "one cell for each column");
        self.rows.push(cells);
    }

    fn to_html(&self) -> String {
        let cell = |tag: &str, column: &Column, text: &str| {
            format!("<{tag}{}>{}</{tag}>", column.class(), escaped(text))
        };
        let titles: String =
            self.columns.iter().map(|column| cell("th scope=\"col\"", column, &column.title)).collect();
        // The closing tag has no attributes.
        let titles = titles.replace("</th scope=\"col\">", "</th>");
        let rows: String = self
            .rows
            .iter()
            .map(|row| {
                let cells: String =
                    self.columns.iter().zip(row).map(|(column, text)| cell("td", column, text)).collect();
                format!("<tr>{cells}</tr>\n")
            })
            .collect();
        format!(
            "<div class=\"table\"><table>\n<thead><tr>{titles}</tr></thead>\n<tbody>\n{rows}</tbody>\n</table></div>\n"
        )
    }
}

impl Page {
    /// A page with nothing on it yet.
    pub fn new(title: &str) -> Self {
        Self {
            title: title.to_string(),
            headings: Vec::new(),
            body: String::new(),
            figures: Vec::new(),
            attached: Vec::new(),
        }
    }

    /// Begins a section.
    pub fn section(&mut self, heading: &str) {
        let id = self.headings.len();
        self.headings.push(heading.to_string());
        self.add(&format!("<h2 id=\"section-{id}\">{}</h2>\n", escaped(heading)));
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: &str) {
        self.add(&format!("<p>{}</p>\n", escaped(text)));
    }

    /// Adds a list of sentences.
    pub fn list<T: AsRef<str>>(&mut self, items: impl IntoIterator<Item = T>) {
        let items: String =
            items.into_iter().map(|item| format!("<li>{}</li>\n", escaped(item.as_ref()))).collect();
        self.add(&format!("<ul>\n{items}</ul>\n"));
    }

    /// Adds what is to be known at a glance: names and values.
    pub fn facts(&mut self, facts: &[(&str, String)]) {
        let facts: String = facts
            .iter()
            .map(|(name, value)| format!("<dt>{}</dt><dd>{}</dd>\n", escaped(name), escaped(value)))
            .collect();
        self.add(&format!("<dl>\n{facts}</dl>\n"));
    }

    /// Adds a table.
    pub fn table(&mut self, table: &Table) {
        self.add(&table.to_html());
    }

    /// Adds a figure.
    ///
    /// # Panics
    /// If there is a figure of this name: their files would be one. A bug of the caller.
    pub fn figure(&mut self, figure: Figure) {
        let name = figure.name();
        assert!(self.figures.iter().all(|other| other.name() != name), "a second figure is named {name}");
        self.add(&figure.to_html());
        self.figures.push(figure);
    }

    /// Adds a file that belongs to the page, for other programs.
    ///
    /// # Panics
    /// If there is a file of this name: a bug of the caller.
    pub fn attach(&mut self, file: ReportFile) {
        assert!(
            self.attached.iter().all(|other| other.name != file.name),
            "a second file is named {}",
            file.name
        );
        self.attached.push(file);
    }

    /// The page: HTML that is well-formed XML too.
    pub fn to_html(&self) -> String {
        let (title, style) = (escaped(&self.title), theme::of_page());
        let links = self.headings.iter().enumerate();
        let links: String = links
            .map(|(id, heading)| format!("<a href=\"#section-{id}\">{}</a> ", escaped(heading)))
            .collect();
        let contents = if links.is_empty() { links } else { format!("<nav>{links}</nav>\n") };
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n<title>{title}</title>\n\
             <style>\n{style}</style>\n</head>\n<body>\n<h1>{title}</h1>\n{contents}{}</body>\n</html>\n",
            self.body
        )
    }

    /// All files of the report: `report.html`, for each figure `NAME.svg` and `NAME.csv`, and what was attached.
    pub fn files(&self) -> Vec<ReportFile> {
        let page = ReportFile { name: "report.html".to_string(), contents: self.to_html() };
        let of_figures = self.figures.iter().flat_map(|figure| {
            let file =
                |extension, contents| ReportFile { name: format!("{}.{extension}", figure.name()), contents };
            [file("svg", figure.to_svg()), file("csv", figure.csv().to_string())]
        });
        [page].into_iter().chain(of_figures).chain(self.attached.iter().cloned()).collect()
    }

    fn add(&mut self, markup: &str) {
        self.body.push_str(markup);
    }
}
