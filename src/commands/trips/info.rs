//! `kinds trips info`: what is in a recording, and what could be learnt from.

use std::io::Write;

use kinds_trips::{Choice, Gives, Role, TopicInfo, TripInfo};
use serde::Serialize;

use crate::cli::InfoArguments;
use crate::failure::Failure;
use crate::log;

pub(crate) fn run(arguments: &InfoArguments) -> Result<(), Failure> {
    let mut info = TripInfo::read(&arguments.trip)?;
    let failure = info.failure.take();
    {
        let mut out = std::io::stdout().lock();
        if arguments.json {
            let report = Report::new(&info, failure.as_ref().map(ToString::to_string));
            writeln!(out, "{}", serde_json::to_string_pretty(&report).expect("a report is plain data"))?;
        } else {
            write!(out, "{}", describe(&info))?;
        }
        out.flush()?;
    }
    if let Some(cut_off) = &info.cut_off {
        log::notice(format!("trip {} {cut_off}", info.path.display()));
    }
    failure.map_or(Ok(()), |failure| Err(failure.into()))
}

/// What `info --json` prints.
#[derive(Serialize)]
struct Report {
    path: String,
    format: String,
    n_bytes: u64,
    first_ns: Option<i64>,
    latest_ns: Option<i64>,
    cut_off: Option<String>,
    damage: Option<String>,
    topics: Vec<TopicReport>,
    frames: Vec<ChoiceReport>,
    poses: Vec<ChoiceReport>,
    commands: Vec<ChoiceReport>,
    /// How to train on it, as words of a command line.
    train: Option<Vec<String>>,
}

#[derive(Serialize)]
struct TopicReport {
    name: String,
    r#type: String,
    n_messages: u64,
    first_ns: Option<i64>,
    latest_ns: Option<i64>,
    rate_hz: Option<f64>,
    n_gaps: u64,
    longest_gap_s: Option<f64>,
    longest_gap_after_ns: Option<i64>,
    n_backwards: u64,
    can_be: Option<String>,
    why_not: Option<String>,
}

#[derive(Serialize)]
struct ChoiceReport {
    topic: String,
    rows: Option<u32>,
    columns: Option<u32>,
    is_default: bool,
}

impl Report {
    fn new(info: &TripInfo, damage: Option<String>) -> Self {
        let choices = |choices: Vec<Choice>| choices.into_iter().map(ChoiceReport::new).collect();
        Self {
            path: info.path.display().to_string(),
            format: info.format.to_string(),
            n_bytes: info.n_bytes,
            first_ns: info.span().map(|(first, _)| first.0),
            latest_ns: info.span().map(|(_, latest)| latest.0),
            cut_off: info.cut_off.clone(),
            damage,
            topics: info.topics.iter().map(TopicReport::new).collect(),
            frames: choices(info.frames()),
            poses: choices(info.beside_frames(Role::Poses)),
            commands: choices(info.beside_frames(Role::Commands)),
            train: train(info),
        }
    }
}

impl TopicReport {
    fn new(topic: &TopicInfo) -> Self {
        let role = |role: Role| Some(role.to_string());
        let (can_be, why_not) = match &topic.gives {
            Gives::Frames(_) => (role(Role::Frames), None),
            Gives::Poses => (role(Role::Poses), None),
            Gives::Commands => (role(Role::Commands), None),
            Gives::Unfit(_, fault) => (None, Some(fault.to_string())),
            Gives::Nothing => (None, None),
        };
        let longest = topic.gaps.map(|(_, longest)| longest);
        Self {
            name: topic.topic.name.clone(),
            r#type: topic.topic.type_name.clone(),
            n_messages: topic.topic.n_messages,
            first_ns: topic.span.map(|(first, _)| first.0),
            latest_ns: topic.span.map(|(_, latest)| latest.0),
            rate_hz: topic.period_s.map(f64::recip),
            n_gaps: topic.gaps.map_or(0, |(n_gaps, _)| n_gaps),
            longest_gap_s: longest.map(|gap| gap.length_s),
            longest_gap_after_ns: longest.map(|gap| gap.after.0),
            n_backwards: topic.n_backwards,
            can_be,
            why_not,
        }
    }
}

impl ChoiceReport {
    fn new(choice: Choice) -> Self {
        Self {
            topic: choice.name,
            rows: choice.layout.map(|layout| layout.rows),
            columns: choice.layout.map(|layout| layout.columns),
            is_default: choice.is_default,
        }
    }
}

fn describe(info: &TripInfo) -> String {
    let (first, length_s) = match info.span() {
        Some((first, latest)) => (Some(first), latest.seconds_since(first)),
        None => (None, 0.0),
    };
    let begin = first.map_or(String::new(), |first| format!(", {length_s:.1} s from {first}"));
    let mut text = format!("{}: {}, {} bytes{begin}\n\n", info.path.display(), info.format, info.n_bytes);
    let names: Vec<String> = info.topics.iter().map(|topic| topic.topic.name.clone()).collect();
    let types: Vec<String> = info.topics.iter().map(|topic| topic.topic.type_name.clone()).collect();
    let (name_width, type_width) = (width("topic", &names), width("type", &types));
    text += &format!("{:name_width$}  {:type_width$}  messages       rate   can be\n", "topic", "type");
    for topic in &info.topics {
        let rate = topic.period_s.map_or("-".to_string(), |period_s| format!("{:.2} Hz", period_s.recip()));
        text += &format!(
            "{:name_width$}  {:type_width$}  {:8} {rate:>10}   {}\n",
            topic.topic.name,
            topic.topic.type_name,
            topic.topic.n_messages,
            can_be(topic)
        );
    }
    text += "\n";
    for topic in &info.topics {
        if let Some((n_gaps, longest)) = topic.gaps {
            let gaps = if n_gaps == 1 { "gap" } else { "gaps" };
            let at_s = first.map_or(0.0, |first| longest.after.seconds_since(first));
            text += &format!(
                "{}: {n_gaps} {gaps}, the longest {:.1} s long, {at_s:.1} s from the beginning\n",
                topic.topic.name, longest.length_s
            );
        }
        if topic.n_backwards > 0 {
            text += &format!("{}: {} messages out of order\n", topic.topic.name, topic.n_backwards);
        }
    }
    for (role, choices) in [
        (Role::Frames, info.frames()),
        (Role::Poses, info.beside_frames(Role::Poses)),
        (Role::Commands, info.beside_frames(Role::Commands)),
    ] {
        if choices.is_empty() {
            text += &format!("{role}: none\n");
        }
        for choice in choices {
            let layout = choice.layout.map_or(String::new(), |layout| format!(" of {layout}"));
            let how = match choice.is_default {
                true => String::new(),
                false => format!(", by --{role}-topic {}", choice.name),
            };
            text += &format!("{role}{layout} from {}{how}\n", choice.name);
        }
    }
    if let Some(words) = train(info) {
        text += &format!("\n{}\n", words.join(" "));
    }
    text
}

fn width(title: &str, texts: &[String]) -> usize {
    texts.iter().map(|text| text.chars().count()).chain([title.len()]).max().unwrap_or(0)
}

fn can_be(topic: &TopicInfo) -> String {
    match &topic.gives {
        Gives::Frames(layout) => format!("frames of {layout}"),
        Gives::Poses => Role::Poses.to_string(),
        Gives::Commands => Role::Commands.to_string(),
        Gives::Unfit(role, fault) => format!("no {role}: {fault}"),
        Gives::Nothing => "-".to_string(),
    }
}

/// A command that learns from the trip, if it has frames: by what is chosen without flags, or what comes first.
fn train(info: &TripInfo) -> Option<Vec<String>> {
    let mut words: Vec<String> = ["kinds", "train"].map(str::to_string).into();
    words.push(info.path.display().to_string());
    words.extend(["--output", "M.kinds"].map(str::to_string));
    let frames = info.frames();
    let mut add_flag = |role: Role, choices: &[Choice]| {
        let is_chosen = choices.iter().any(|choice| choice.is_default);
        if let (false, Some(first)) = (is_chosen, choices.first()) {
            words.extend([format!("--{role}-topic"), first.name.clone()]);
        }
    };
    add_flag(Role::Frames, &frames);
    add_flag(Role::Poses, &info.beside_frames(Role::Poses));
    (!frames.is_empty()).then_some(words)
}
