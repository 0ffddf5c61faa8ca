//! `kinds check`: whether configuration files are right, and where they are not.

use std::fmt::Display;
use std::path::Path;

use clap::ValueEnum;
use kinds_driver_shim::Faults;
use kinds_trainer::Config;

#[cfg(feature = "bridge")]
use crate::cli::BridgeConfig;
use crate::cli::{CheckArguments, JoinConfig, PublishConfig, RecordConfig, ServeConfig, Sort};
use crate::failure::Failure;
use crate::realtime::Realtime;
use crate::say::say;
use crate::{log, ron_file};

pub(crate) fn run(arguments: &CheckArguments) -> Result<(), Failure> {
    let mut failures = Vec::new();
    for path in &arguments.files {
        match check(path, arguments.sort) {
            Ok(sort) => say(format!("{} is right, for {}", path.display(), purpose(sort)))?,
            Err(failure) => failures.push(failure),
        }
    }
    // A file that says what cannot be is worse than one that is not there: its exit code counts.
    failures.sort_by_key(|failure| matches!(failure, Failure::AskedWrongly(_)));
    let worst = failures.pop();
    failures.iter().for_each(log::failure);
    worst.map_or(Ok(()), Err)
}

/// The flag that takes such a file.
fn purpose(sort: Sort) -> String {
    let value = sort.to_possible_value().expect("none is skipped");
    value.get_help().expect("each has its words").to_string()
}

fn check(path: &Path, sort: Option<Sort>) -> Result<Sort, Failure> {
    const WHAT: &str = "configuration";
    let text = ron_file::text(WHAT, path)?;
    let wrong = |words: String| ron_file::wrong(WHAT, path, words);
    let sort = match sort {
        Some(sort) => sort,
        None => sort_of(&text).map_err(wrong)?,
    };
    match sort {
        Sort::Serve => ron_file::parse::<ServeConfig>(&text).and_then(|config| said(config.plan())),
        Sort::Publish => ron_file::parse::<PublishConfig>(&text).and_then(|config| said(config.plan())),
        Sort::Join => ron_file::parse::<JoinConfig>(&text).and_then(|config| said(config.joint())),
        Sort::Record => ron_file::parse::<RecordConfig>(&text).and_then(|config| said(config.plan())),
        #[cfg(feature = "bridge")]
        Sort::Bridge => ron_file::parse::<BridgeConfig>(&text).and_then(|config| said(config.plan())),
        Sort::Train => ron_file::parse::<Config>(&text).and_then(|config| said(config.check())),
        Sort::Faults => ron_file::parse::<Faults>(&text).and_then(|faults| said(faults.check())),
        Sort::Realtime => ron_file::parse::<Realtime>(&text).map(drop),
    }
    .map_err(|words| wrong(placed(&text, words)))?;
    Ok(sort)
}

fn said<T>(checked: Result<T, impl Display>) -> Result<(), String> {
    checked.map(drop).map_err(|error| error.to_string())
}

/// Words on a field's value with the field's place, where they begin with it as in "kinds is 65; …".
fn placed(text: &str, words: String) -> String {
    let Some((field, _)) = words.split_once(" is ") else { return words };
    let is_of_name = |c: char| c.is_alphanumeric() || c == '_';
    for (line, number) in text.lines().zip(1..) {
        let code = line.split("//").next().unwrap_or_default();
        let found = code.match_indices(field).find(|(at, _)| {
            let (before, after) = (&code[..*at], &code[at + field.len()..]);
            !before.ends_with(is_of_name) && after.trim_start().starts_with(':')
        });
        if let Some((at, _)) = found {
            let column = code[..at].chars().count() + 1;
            return format!("line {number}, column {column}: {words}");
        }
    }
    words
}

/// What a file says that it is for.
fn sort_of(text: &str) -> Result<Sort, String> {
    let word = first_word(text);
    let sorts = Sort::value_variants();
    sorts.iter().copied().find(|sort| sort.word() == word).ok_or_else(|| {
        let words: Vec<_> = sorts.iter().map(|sort| sort.word()).collect();
        let found = if word.is_empty() { "with no word".to_string() } else { format!("with {word}") };
        format!(
            "it begins {found} of {}, so nobody knows what it is for; write one before its first bracket, or say it with --as",
            words.join(", ")
        )
    })
}

/// The word before the first bracket, after comments and attributes; empty if there is none.
fn first_word(text: &str) -> &str {
    let mut rest = text.trim_start();
    loop {
        let end = if rest.starts_with("//") || rest.starts_with("#!") {
            "\n"
        } else if rest.starts_with("/*") {
            "*/"
        } else {
            break;
        };
        rest = rest.split_once(end).map_or("", |(_, rest)| rest).trim_start();
    }
    let is_of_word = |c: char| c.is_alphanumeric() || c == '_';
    &rest[..rest.find(|c| !is_of_word(c)).unwrap_or(rest.len())]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_word_stands_after_comments_and_attributes() {
        for (text, word) in [
            ("Serve()", "Serve"),
            ("// what\n/* and\n why */ #![enable(implicit_some)]\nRecord (", "Record"),
            ("()", ""),
            ("// Serve(", ""),
            ("", ""),
        ] {
            assert_eq!(first_word(text), word, "{text:?}");
        }
    }
}
