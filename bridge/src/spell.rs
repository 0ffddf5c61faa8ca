//! Something that reports show now and then: told when it begins and when it is over, and not for every report.

/// Reports in a row without it after which a spell is over.
const CALM_REPORTS: u64 = 100;

/// How often something was, and whether it still is.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Spell {
    /// In all.
    n: u64,
    lasting: Option<Lasting>,
}

#[derive(Clone, Copy, Debug)]
struct Lasting {
    /// Since it began.
    n: u64,
    /// Reports without it since the last time.
    n_calm: u64,
}

impl Spell {
    /// How often it was in all.
    pub(crate) fn n(&self) -> u64 {
        self.n
    }

    /// It was, so many times. Returns whether that begins a spell.
    pub(crate) fn count(&mut self, n: u64) -> bool {
        let begins = self.lasting.is_none();
        let n_before = self.lasting.map_or(0, |lasting| lasting.n);
        self.lasting = Some(Lasting { n: n_before + n, n_calm: 0 });
        self.n += n;
        begins
    }

    /// A report came without it. Returns how often it was in the spell that this ends.
    pub(crate) fn calm(&mut self) -> Option<u64> {
        let lasting = self.lasting.as_mut()?;
        lasting.n_calm += 1;
        let ended = (lasting.n_calm == CALM_REPORTS).then_some(lasting.n);
        if ended.is_some() {
            self.lasting = None;
        }
        ended
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spell_begins_once_and_ends_after_a_hundred_reports_without_it() {
        let mut spell = Spell::default();
        assert_eq!(spell.calm(), None);
        assert!(spell.count(2));
        assert!((0..99).all(|_| spell.calm().is_none()));
        assert!(!spell.count(3), "it goes on");
        assert!((0..99).all(|_| spell.calm().is_none()));
        assert_eq!(spell.calm(), Some(5));
        assert_eq!(spell.calm(), None, "it is over once");
        assert!(spell.count(1));
        assert_eq!(spell.n(), 6);
    }
}
