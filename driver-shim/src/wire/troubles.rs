//! What comes from a device and is no frame: counted, and said once when it begins and once when it ends.

use std::collections::VecDeque;
use std::fmt;

use kinds_messages::Spell;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Trouble {
    /// Bytes of no part.
    Noise,
    /// Parts of another layout.
    Foreign,
    /// Frames that lack a part.
    Incomplete,
    /// Parts of frames that came before.
    Late,
}

const N_TROUBLES: usize = 4;

/// How much of what a device sent was left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// Bytes of no part.
    pub n_noise_bytes: u64,
    /// Parts of frames of another layout.
    pub n_foreign_parts: u64,
    /// Frames that lacked a part.
    pub n_incomplete: u64,
    /// Parts that came again, or after a later frame.
    pub n_late_parts: u64,
}

impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { n_noise_bytes, n_foreign_parts, n_incomplete, n_late_parts } = self;
        write!(
            f,
            "{n_noise_bytes} bytes that were no part of a frame, {n_foreign_parts} parts of another layout, \
             {n_incomplete} frames that lacked a part, {n_late_parts} parts that came late or again"
        )
    }
}

#[derive(Default)]
pub(crate) struct Troubles {
    spells: [Spell; N_TROUBLES],
    news: VecDeque<String>,
}

impl Troubles {
    pub(crate) fn count(&mut self, trouble: Trouble, n: usize) {
        self.count_as(trouble, n, || {
            match trouble {
                Trouble::Noise => "bytes come that are no whole frame; they are left out",
                Trouble::Foreign => "frames of another layout come; they are left out",
                Trouble::Incomplete => "frames come that lack a part; they are left out",
                Trouble::Late => "frames come late or again; they are left out",
            }
            .to_owned()
        });
    }

    /// As [`Self::count`], with words of one's own for its beginning.
    pub(crate) fn count_as(&mut self, trouble: Trouble, n: usize, words: impl FnOnce() -> String) {
        if self.spells[trouble as usize].count(n as u64) {
            self.news.push_back(words());
        }
    }

    /// A whole frame has come.
    pub(crate) fn frame_came(&mut self) {
        let what = ["bytes", "parts of another layout", "frames that lacked a part", "late parts"];
        for (spell, what) in self.spells.iter_mut().zip(what) {
            if let Some(n) = spell.calm() {
                self.news.push_back(format!("frames come as they should again; {n} {what} were left out"));
            }
        }
    }

    /// Something else to say.
    pub(crate) fn say(&mut self, words: String) {
        self.news.push_back(words);
    }

    /// The oldest that has not been said.
    pub(crate) fn news(&mut self) -> Option<String> {
        self.news.pop_front()
    }

    pub(crate) fn left_out(&self) -> LeftOut {
        let n = |trouble: Trouble| self.spells[trouble as usize].n();
        LeftOut {
            n_noise_bytes: n(Trouble::Noise),
            n_foreign_parts: n(Trouble::Foreign),
            n_incomplete: n(Trouble::Incomplete),
            n_late_parts: n(Trouble::Late),
        }
    }
}
