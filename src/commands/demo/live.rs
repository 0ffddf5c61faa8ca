//! What a person sees while the demo's service classifies: the path so far in the colours of its kinds, and the kinds of
//! the frame that was just classified.

use std::io::{IsTerminal, Stdout, Write, stdout};
use std::path::Path;
use std::time::{Duration, Instant};

use kinds_messages::{KindReport, ReportStatus};
use kinds_trips::{Pose, Selection, TripReader};
use ratatui::backend::CrosstermBackend;
use ratatui::layout::{Constraint, Layout, Position, Rect};
use ratatui::style::{Color, Stylize};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;
use ratatui::widgets::canvas::{Canvas, Points};
use ratatui::{Frame, Terminal, TerminalOptions, Viewport};

use crate::commands::watch;
use crate::failure::Failure;
use crate::say::say;

/// Rows of the picture.
const HEIGHT: u16 = 16;

/// Columns that the kinds take beside the path.
const KINDS_WIDTH: u16 = 34;

/// The terminal's own, orange, sky blue, green, yellow, blue, vermilion, purple: told apart by people who see few colours,
/// and in the report's order.
const COLOURS: [Color; 8] = [
    Color::Reset,
    Color::Indexed(214),
    Color::Indexed(74),
    Color::Indexed(36),
    Color::Indexed(227),
    Color::Indexed(27),
    Color::Indexed(166),
    Color::Indexed(175),
];

/// Least time between two pictures: more of them cost more than they show.
const PERIOD: Duration = Duration::from_millis(40);

/// What is known of a trip before it is replayed.
pub(crate) struct Course {
    /// Where each frame was, by its number.
    poses: Vec<Option<Pose>>,
    pub(crate) duration_s: f64,
}

/// A picture of a trip while it is classified; nothing where standard output is not a terminal.
pub(crate) struct LiveView<'a> {
    course: &'a Course,
    screen: Screen,
    last_shown: Option<Instant>,
}

enum Screen {
    None,
    /// A terminal that does not say where its cursor is: one line, written again and again.
    Line,
    Picture(Box<Terminal<CrosstermBackend<Stdout>>>),
}

impl Course {
    pub(crate) fn read(trip: &Path, selection: &Selection) -> Result<Self, Failure> {
        let mut reader = TripReader::open(trip, selection)?;
        let mut counts = vec![0; reader.layout().n_readings()];
        let mut poses = Vec::new();
        let (mut first, mut last) = (None, 0);
        while let Some(frame) = reader.next_frame(&mut counts)? {
            poses.push(frame.pose);
            last = frame.captured.0;
            first.get_or_insert(last);
        }
        Ok(Self { poses, duration_s: first.map_or(0.0, |first| (last - first) as f64 / 1e9) })
    }

    pub(crate) fn n_frames(&self) -> u64 {
        self.poses.len() as u64
    }
}

impl<'a> LiveView<'a> {
    /// Makes room for the picture of a trip.
    pub(crate) fn of(course: &'a Course) -> Self {
        let options = TerminalOptions { viewport: Viewport::Inline(HEIGHT) };
        let screen = if !stdout().is_terminal() {
            Screen::None
        } else {
            Terminal::with_options(CrosstermBackend::new(stdout()), options)
                .map_or(Screen::Line, |terminal| Screen::Picture(Box::new(terminal)))
        };
        Self { course, screen, last_shown: None }
    }

    /// Shows all reports so far, unless it just did.
    pub(crate) fn show(&mut self, reports: &[KindReport]) -> Result<(), Failure> {
        match self.last_shown {
            Some(last_shown) if last_shown.elapsed() < PERIOD => Ok(()),
            _ => self.draw(reports),
        }
    }

    fn draw(&mut self, reports: &[KindReport]) -> Result<(), Failure> {
        let Some(last) = reports.last() else { return Ok(()) };
        self.last_shown = Some(Instant::now());
        match &mut self.screen {
            Screen::None => {}
            Screen::Line => {
                let mut out = stdout().lock();
                write!(out, "\r\x1b[K   {}", watch::text_line(last))?;
                out.flush()?;
            }
            Screen::Picture(terminal) => {
                terminal.draw(|frame| draw(frame, &self.course.poses, reports, last))?;
            }
        }
        Ok(())
    }

    /// Leaves the picture of all reports where it is, and the cursor below it.
    pub(crate) fn end(mut self, reports: &[KindReport]) -> Result<(), Failure> {
        self.draw(reports)?;
        match self.screen {
            Screen::None => {}
            Screen::Line => write!(stdout(), "\r\x1b[K")?,
            Screen::Picture(_) => say("")?,
        }
        Ok(())
    }
}

fn draw(frame: &mut Frame, poses: &[Option<Pose>], reports: &[KindReport], last: &KindReport) {
    let whole = frame.area();
    let rows = Layout::vertical([Constraint::Fill(1), Constraint::Length(1)]);
    let [picture, below] = whole.layout(&rows);
    let columns =
        Layout::horizontal([Constraint::Length(3), Constraint::Fill(1), Constraint::Length(KINDS_WIDTH)]);
    let [_margin, path, kinds] = picture.layout(&columns);
    draw_path(frame, path, poses, reports);
    frame.render_widget(Paragraph::new(kind_lines(last, poses.len())), kinds);
    // Where whatever is printed next goes on.
    frame.set_cursor_position(Position { x: below.x, y: below.y });
}

/// The path so far, to scale: a dot of a terminal's braille is about as high as it is wide.
fn draw_path(frame: &mut Frame, area: Rect, poses: &[Option<Pose>], reports: &[KindReport]) {
    let Some([x_m, y_m]) = extent(poses) else { return };
    let (width, height) = (f64::from(2 * area.width.max(1)), f64::from(4 * area.height.max(1)));
    let metres_per_dot = ((x_m[1] - x_m[0]) / width).max((y_m[1] - y_m[0]) / height).max(f64::MIN_POSITIVE);
    let around = |[low, high]: [f64; 2], n_dots: f64| {
        let (middle, half) = (0.5 * (low + high), 0.5 * metres_per_dot * n_dots);
        [middle - half, middle + half]
    };
    let mut places = vec![Vec::new(); COLOURS.len()];
    for report in reports.iter().filter(|report| report.status() == ReportStatus::Classified) {
        if let Some(Some(pose)) = poses.get(report.sequence as usize) {
            places[report.filtered_kind as usize % COLOURS.len()].push((pose.x_m, pose.y_m));
        }
    }
    let canvas = Canvas::default()
        .marker(Marker::Braille)
        .x_bounds(around(x_m, width))
        .y_bounds(around(y_m, height))
        .paint(|context| {
            for (coords, color) in places.iter().zip(COLOURS) {
                context.draw(&Points { coords, color });
            }
        });
    frame.render_widget(canvas, area);
}

/// Least and largest x and y, metres.
fn extent(poses: &[Option<Pose>]) -> Option<[[f64; 2]; 2]> {
    let mut known = poses.iter().flatten();
    let first = known.next()?;
    let start = [[first.x_m; 2], [first.y_m; 2]];
    let wider = |[low, high]: [f64; 2], value: f64| [low.min(value), high.max(value)];
    Some(known.fold(start, |[x_m, y_m], pose| [wider(x_m, pose.x_m), wider(y_m, pose.y_m)]))
}

fn kind_lines(report: &KindReport, n_frames: usize) -> Vec<Line<'static>> {
    const BAR_WIDTH: f64 = 16.0;
    let probabilities = report.filtered();
    // Kinds beyond what there is room for are not the first ones that anybody trains with.
    let n_shown = probabilities.len().min(usize::from(HEIGHT) - 5);
    let mut lines: Vec<Line> = (0..n_shown)
        .map(|kind| {
            let share = probabilities[kind];
            let bar = "█".repeat((BAR_WIDTH * share).round() as usize);
            let text = format!("  kind {kind:2} {:3.0} % ", 100.0 * share);
            let is_now = report.status() == ReportStatus::Classified && kind == report.filtered_kind as usize;
            let name = if is_now { Span::from(text).bold() } else { Span::from(text) };
            Line::from(vec![name, Span::from(bar).fg(COLOURS[kind % COLOURS.len()])])
        })
        .collect();
    lines.push(Line::default());
    lines.push(Line::from(format!("  frame {} of {n_frames}", report.sequence + 1)));
    lines.push(Line::from(format!("  novelty {:.2}", report.novelty)));
    lines.push(Line::from(format!("  frame to report {:.0} µs", watch::latency_ns(report) as f64 / 1e3)));
    lines
}
