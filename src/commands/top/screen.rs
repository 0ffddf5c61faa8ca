//! All sensors on one screen, and all about one of them.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use kinds_messages::SensorName;
use ratatui::Frame;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ratatui::layout::{Constraint, Layout};
use ratatui::style::{Style, Stylize};
use ratatui::text::Line;
use ratatui::widgets::{List, ListState, Paragraph, Wrap};

use crate::commands::top::PERIOD;
use crate::commands::top::observer::{Observer, Seen, Service};
use crate::commands::top::table;
use crate::failure::Failure;
use crate::kind_names::KindNames;

/// Longest time until a word of a service, or a signal, is seen to.
const WAIT: Duration = Duration::from_millis(200);

/// Rows that all about one sensor takes.
const DETAILS_HEIGHT: u16 = 17;

/// What a key asks for.
#[derive(Debug, PartialEq, Eq)]
enum Wish {
    End,
    Move(isize),
    Nothing,
}

/// Shows all until somebody has seen enough. The terminal is as before afterwards.
pub(crate) fn show(mut observer: Observer, stop: &AtomicBool) -> Result<(), Failure> {
    let mut terminal = ratatui::try_init()?;
    let mut shown = || -> Result<(), Failure> {
        let mut selected = None;
        let mut last_look: Option<Instant> = None;
        while !stop.load(Ordering::Relaxed) {
            if last_look.is_none_or(|last_look| last_look.elapsed() >= PERIOD) {
                last_look = Some(Instant::now());
                observer.look()?;
            }
            observer.receive();
            terminal.draw(|frame| draw(frame, &observer, selected.as_ref()))?;
            if event::poll(WAIT)? {
                match wish(&event::read()?) {
                    Wish::End => break,
                    Wish::Move(by) => selected = moved(&observer, selected.as_ref(), by),
                    Wish::Nothing => {}
                }
            }
        }
        Ok(())
    };
    let shown = shown();
    ratatui::try_restore()?;
    shown
}

fn wish(event: &Event) -> Wish {
    match event {
        Event::Key(KeyEvent { code, modifiers, kind: KeyEventKind::Press, .. }) => match code {
            KeyCode::Char('q') | KeyCode::Esc => Wish::End,
            // The terminal sends no signal while it tells of every key.
            KeyCode::Char('c') if modifiers.contains(KeyModifiers::CONTROL) => Wish::End,
            KeyCode::Up | KeyCode::Char('k') => Wish::Move(-1),
            KeyCode::Down | KeyCode::Char('j') => Wish::Move(1),
            _ => Wish::Nothing,
        },
        _ => Wish::Nothing,
    }
}

/// Place of the sensor that is selected: the first, unless somebody chose another that is still there.
fn place(observer: &Observer, selected: Option<&SensorName>) -> usize {
    observer.sensors.keys().position(|sensor| Some(sensor) == selected).unwrap_or(0)
}

/// Which sensor is so many places from the one that is selected.
fn moved(observer: &Observer, selected: Option<&SensorName>, by: isize) -> Option<SensorName> {
    let last = observer.sensors.len().checked_sub(1)?;
    let place = place(observer, selected).saturating_add_signed(by).min(last);
    observer.sensors.keys().nth(place).cloned()
}

fn draw(frame: &mut Frame, observer: &Observer, selected: Option<&SensorName>) {
    let n_sensors = observer.sensors.len();
    let rows = [
        Constraint::Length(2),
        Constraint::Length(1),
        // All sensors, or as many as there is room for beside what is said about one.
        Constraint::Max(u16::try_from(n_sensors).unwrap_or(u16::MAX)),
        Constraint::Length(1),
        Constraint::Min(DETAILS_HEIGHT.min(frame.area().height / 2)),
    ];
    let [title, heading, list, _gap, details] = frame.area().layout(&Layout::vertical(rows));
    let domain = observer.domain.root.display();
    let is_many = if n_sensors > 1 { ", ↑ and ↓ choose" } else { "" };
    let words = format!("kinds top: sensors of domain {domain}; q ends{is_many}");
    frame.render_widget(Line::from(words).dim(), title);
    let place = place(observer, selected);
    let Some((sensor, seen)) = observer.sensors.iter().nth(place) else {
        frame.render_widget(
            Paragraph::new(table::nobody(observer)).wrap(Wrap { trim: true }),
            list.union(details),
        );
        return;
    };
    let width = table::name_width(observer);
    frame.render_widget(Line::from(table::heading(width)).bold(), heading);
    let rows = observer.sensors.iter().map(|(sensor, seen)| row(sensor, seen, width));
    // Of one sensor alone there is nothing to choose.
    let highlight = if n_sensors > 1 { Style::new().reversed() } else { Style::new() };
    let mut state = ListState::default().with_selected(Some(place));
    frame.render_stateful_widget(List::new(rows).highlight_style(highlight), list, &mut state);
    frame.render_widget(
        Paragraph::new(about(sensor, seen, &observer.names)).wrap(Wrap { trim: false }),
        details,
    );
}

/// A row of the list, in yellow where somebody should see to something.
fn row(sensor: &SensorName, seen: &Seen, width: usize) -> Line<'static> {
    let row = Line::from(table::row(sensor, seen, width));
    match (seen.service(), table::remark(seen)) {
        (_, Some(_)) => row.yellow(),
        (Service::None, None) => row.dim(),
        _ => row,
    }
}

/// All about one sensor.
fn about(sensor: &SensorName, seen: &Seen, names: &KindNames) -> Vec<Line<'static>> {
    let mut lines = vec![Line::from(sensor.to_string()).bold()];
    lines.push(Line::from(table::connections(&seen.programs)));
    lines.extend(table::named(seen, names).map(Line::from));
    lines.extend(table::whereabouts(seen).map(Line::from));
    lines.extend(table::remark(seen).map(|remark| Line::from(remark).yellow()));
    if let Service::Heard { said, .. } = seen.service() {
        lines.extend(table::details(said).into_iter().map(Line::from));
    }
    lines
}

#[cfg(test)]
mod tests {
    use kinds_messages::{HealthPublisher, HealthReport, Node, OwnDomain, monotonic_ns};
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    use super::*;

    fn picture(observer: &Observer, selected: Option<&SensorName>) -> Vec<String> {
        let mut terminal = Terminal::new(TestBackend::new(80, 24)).unwrap();
        terminal.draw(|frame| draw(frame, observer, selected)).unwrap();
        let buffer = terminal.backend().buffer().clone();
        let rows = buffer.content().chunks(80);
        rows.map(|row| row.iter().map(|cell| cell.symbol()).collect::<String>().trim_end().to_string())
            .collect()
    }

    #[test]
    fn the_sensor_that_is_chosen_is_shown_in_full_on_80_columns_and_24_rows() {
        let domain = OwnDomain::make().unwrap();
        let mut observer = Observer::join((*domain).clone(), KindNames::default()).unwrap();
        observer.look().unwrap();
        let text = picture(&observer, None).join(" ");
        assert!(text.contains("no sensor in domain") && text.contains("start kinds publish or"), "{text}");

        let node = Node::open(&domain, "service").unwrap();
        let sensors = (0..5).map(|n_lost| format!("robot/{n_lost}").parse().unwrap());
        let services: Vec<_> =
            sensors.map(|sensor| HealthPublisher::create(&node, &sensor).unwrap()).collect();
        observer.look().unwrap();
        for (n_lost, service) in (0..).zip(&services) {
            let sent_monotonic_ns = monotonic_ns();
            service.send(&HealthReport { n_lost, sent_monotonic_ns, ..HealthReport::default() }).unwrap();
        }
        observer.receive();
        let first = picture(&observer, None);
        let mut selected = None;
        for _ in 0..9 {
            selected = moved(&observer, selected.as_ref(), 1);
        }
        let last = picture(&observer, selected.as_ref());
        for (picture, sensor, lost) in
            [(first, "robot/0", "lost 0   late 0"), (last, "robot/4", "lost 4   late 0")]
        {
            assert!(picture.iter().any(|row| row == sensor), "{picture:#?}");
            assert!(picture.iter().any(|row| row.starts_with(lost)), "{picture:#?}");
            assert!(picture.iter().any(|row| row.starts_with("reloads 0")), "{picture:#?}");
            assert_eq!(picture.iter().filter(|row| row.contains("no frame yet")).count(), 5, "{picture:#?}");
        }
    }

    #[test]
    fn q_escape_and_control_c_end() {
        let press = |code, modifiers| wish(&Event::Key(KeyEvent::new(code, modifiers)));
        for (code, modifiers, expected) in [
            (KeyCode::Char('q'), KeyModifiers::NONE, Wish::End),
            (KeyCode::Esc, KeyModifiers::NONE, Wish::End),
            (KeyCode::Char('c'), KeyModifiers::CONTROL, Wish::End),
            (KeyCode::Char('c'), KeyModifiers::NONE, Wish::Nothing),
            (KeyCode::Up, KeyModifiers::NONE, Wish::Move(-1)),
            (KeyCode::Char('j'), KeyModifiers::NONE, Wish::Move(1)),
        ] {
            assert_eq!(press(code, modifiers), expected, "{code:?}");
        }
    }
}
