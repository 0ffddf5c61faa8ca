//! Register: what people call a model's kinds.
//!
//! A kind's *number* is its for ever. In a model that was trained it is the kind's index; one that was updated gives kinds that
//! it knows again the numbers that they had, and new ones numbers that no kind has had before. So names, notes and programs
//! that ask for a kind by its number outlive an update.

use serde::{Deserialize, Serialize};

/// Most characters of a name: a word or two in a table.
const N_NAME_CHARACTERS_MAX: usize = 40;
/// Most characters of a note.
const N_NOTE_CHARACTERS_MAX: usize = 400;

/// What a kind is called.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KindRecord {
    /// Its number, which no other kind has or will have.
    pub number: u32,
    /// A person's word for it; empty where nobody has given one.
    pub name: String,
    /// What else a person has to say of it.
    pub note: String,
}

/// The records of a model's kinds, and of those that it had.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Register {
    /// By index, shape `(n_kinds,)`; numbers ascend.
    pub(crate) kinds: Vec<KindRecord>,
    /// Of kinds that updates did not find again, oldest first.
    pub(crate) retired: Vec<KindRecord>,
}

/// Why a kind cannot be called so.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NameError {
    /// Another model's, or a slip.
    #[error("the model has no kind {number}; it has {known}")]
    Unknown {
        /// What was asked for.
        number: u32,
        /// Those that there are, in words.
        known: String,
    },
    /// It had one.
    #[error("kind {number} was retired by an update: the model has {known}")]
    Retired {
        /// What was asked for.
        number: u32,
        /// Those that there are, in words.
        known: String,
    },
    /// Nothing, or only blanks.
    #[error("the {what} is empty; to take it away, clear it")]
    Empty {
        /// Name or note.
        what: &'static str,
    },
    /// Too long.
    #[error("the {what} has {n_characters} characters; it may have {limit}")]
    Long {
        /// Name or note.
        what: &'static str,
        /// How many it has.
        n_characters: usize,
        /// How many it may have.
        limit: usize,
    },
    /// Something that would spoil a table or a terminal.
    #[error("the {what} has the control character U+{:04X}; leave it out", *character as u32)]
    Control {
        /// Name or note.
        what: &'static str,
        /// The first of them.
        character: char,
    },
}

impl KindRecord {
    fn is_sound(&self) -> bool {
        let is_nothing_or =
            |text: &str, checked: fn(&str) -> Result<(), NameError>| text.is_empty() || checked(text).is_ok();
        is_nothing_or(&self.name, check_name) && is_nothing_or(&self.note, check_note)
    }
}

impl Register {
    /// Of so many kinds that nobody has named, numbered from 0.
    pub fn new(n_kinds: usize) -> Self {
        let record = |number| KindRecord { number, ..KindRecord::default() };
        Self { kinds: (0..n_kinds as u32).map(record).collect(), retired: Vec::new() }
    }

    /// By index, shape `(n_kinds,)`; numbers ascend.
    pub fn kinds(&self) -> &[KindRecord] {
        &self.kinds
    }

    /// Of kinds that the model had before it was updated, oldest first.
    pub fn retired(&self) -> &[KindRecord] {
        &self.retired
    }

    /// What a kind is called in a file or beside an axis, where there is no room for words.
    ///
    /// * `kind` — its index
    pub fn number(&self, kind: usize) -> u32 {
        self.kinds[kind].number
    }

    /// Number and, in brackets, name of a kind.
    ///
    /// * `kind` — its index
    pub fn label(&self, kind: usize) -> String {
        let KindRecord { number, name, .. } = &self.kinds[kind];
        if name.is_empty() { number.to_string() } else { format!("{number} ({name})") }
    }

    /// Calls a kind by a name, or gives it a note; what is not given stays.
    ///
    /// # Errors
    /// If there is no such kind, or no table could show the words.
    pub(crate) fn name(
        &mut self,
        number: u32,
        name: Option<&str>,
        note: Option<&str>,
    ) -> Result<(), NameError> {
        name.map_or(Ok(()), check_name)?;
        note.map_or(Ok(()), check_note)?;
        let record = self.record(number)?;
        name.into_iter().for_each(|name| record.name = name.to_string());
        note.into_iter().for_each(|note| record.note = note.to_string());
        Ok(())
    }

    /// Takes name and note from a kind.
    ///
    /// # Errors
    /// If there is no such kind.
    pub(crate) fn clear(&mut self, number: u32) -> Result<(), NameError> {
        *self.record(number)? = KindRecord { number, ..KindRecord::default() };
        Ok(())
    }

    fn record(&mut self, number: u32) -> Result<&mut KindRecord, NameError> {
        match self.kinds.iter().position(|record| record.number == number) {
            Some(kind) => Ok(&mut self.kinds[kind]),
            None if self.retired.iter().any(|record| record.number == number) => {
                Err(NameError::Retired { number, known: self.known() })
            }
            None => Err(NameError::Unknown { number, known: self.known() }),
        }
    }

    /// The lowest number that no kind has had.
    pub(crate) fn next_number(&self) -> u32 {
        self.kinds.iter().chain(&self.retired).map(|record| record.number + 1).max().unwrap_or(0)
    }

    fn known(&self) -> String {
        let numbers: Vec<String> = self.kinds.iter().map(|record| record.number.to_string()).collect();
        match &numbers[..] {
            [one] => format!("only kind {one}"),
            [others @ .., last] => format!("kinds {} and {last}", others.join(", ")),
            [] => "none".to_string(),
        }
    }

    /// Whether it is of so many kinds, with numbers and words that can be.
    pub(crate) fn fits(&self, n_kinds: usize) -> bool {
        let mut numbers: Vec<u32> =
            self.kinds.iter().chain(&self.retired).map(|record| record.number).collect();
        numbers.sort_unstable();
        self.kinds.len() == n_kinds
            && self.kinds.is_sorted_by_key(|record| record.number)
            && numbers.windows(2).all(|pair| pair[0] != pair[1])
            && numbers.last() != Some(&u32::MAX)
            && self.kinds.iter().chain(&self.retired).all(KindRecord::is_sound)
    }
}

fn check_name(name: &str) -> Result<(), NameError> {
    check("name", name, N_NAME_CHARACTERS_MAX)
}

fn check_note(note: &str) -> Result<(), NameError> {
    check("note", note, N_NOTE_CHARACTERS_MAX)
}

fn check(what: &'static str, text: &str, limit: usize) -> Result<(), NameError> {
    if text.trim().is_empty() {
        return Err(NameError::Empty { what });
    }
    if let Some(character) = text.chars().find(|character| character.is_control()) {
        return Err(NameError::Control { what, character });
    }
    match text.chars().count() {
        n_characters if n_characters > limit => Err(NameError::Long { what, n_characters, limit }),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_that_no_table_could_show_and_kinds_that_there_are_not_are_refused_in_words() {
        let mut register = Register::new(3);
        register.retired.push(KindRecord { number: 7, ..KindRecord::default() });
        let before = register.clone();
        let mut refuse = |number, name: &str, note: Option<&str>| {
            register.name(number, Some(name), note).unwrap_err().to_string()
        };
        assert_eq!(refuse(3, "doorway", None), "the model has no kind 3; it has kinds 0, 1 and 2");
        assert_eq!(
            refuse(7, "doorway", None),
            "kind 7 was retired by an update: the model has kinds 0, 1 and 2"
        );
        assert_eq!(refuse(1, " ", None), "the name is empty; to take it away, clear it");
        assert_eq!(refuse(1, &"ä".repeat(41), None), "the name has 41 characters; it may have 40");
        assert_eq!(refuse(1, "door\nway", None), "the name has the control character U+000A; leave it out");
        assert_eq!(
            refuse(1, "door", Some("\u{1b}[2J")),
            "the note has the control character U+001B; leave it out"
        );
        assert_eq!(refuse(1, "door", Some(&"x".repeat(401))), "the note has 401 characters; it may have 400");
        assert_eq!(register, before, "what is refused changes nothing");
        let only = Register::new(1).name(4, Some("door"), None).unwrap_err().to_string();
        assert_eq!(only, "the model has no kind 4; it has only kind 0");
    }

    #[test]
    fn a_name_stays_until_another_is_given_or_it_is_cleared() {
        let mut register = Register::new(2);
        register.name(1, Some("Türrahmen"), Some("auch der Aufzug")).unwrap();
        assert_eq!((register.label(0), register.label(1)), ("0".to_string(), "1 (Türrahmen)".to_string()));
        register.name(1, None, Some("ohne den Aufzug")).unwrap();
        assert_eq!((&*register.kinds[1].name, &*register.kinds[1].note), ("Türrahmen", "ohne den Aufzug"));
        register.clear(1).unwrap();
        assert_eq!(register, Register::new(2));
    }

    #[test]
    fn a_register_that_cannot_be_is_seen() {
        let record =
            |number, name: &str| KindRecord { number, name: name.to_string(), ..KindRecord::default() };
        let fits = |kinds: &[KindRecord], retired: &[KindRecord]| {
            Register { kinds: kinds.to_vec(), retired: retired.to_vec() }.fits(2)
        };
        assert!(fits(&[record(1, ""), record(4, "door")], &[record(2, "")]));
        assert!(!fits(&[record(1, "")], &[]), "too few");
        assert!(!fits(&[record(4, ""), record(1, "")], &[]), "not ascending");
        assert!(!fits(&[record(1, ""), record(1, "")], &[]), "twice");
        assert!(!fits(&[record(1, ""), record(4, "")], &[record(4, "")]), "retired and not");
        assert!(!fits(&[record(1, ""), record(4, "a\u{7}")], &[]), "cannot be shown");
        assert!(!fits(&[record(1, ""), record(u32::MAX, "")], &[]), "no number is left");
    }
}
