//! Something that goes wrong with messages now and then: told when it begins and when it is over, and not for every message.

/// Messages in a row without it after which a spell is over.
const CALM_MESSAGES: u64 = 100;

/// How often something went wrong, and whether it still does: with frames of a device, or with reports on their way.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spell {
    /// In all.
    n: u64,
    lasting: Option<Lasting>,
}

#[derive(Clone, Copy, Debug)]
struct Lasting {
    /// Since it began.
    n: u64,
    /// Messages without it since the last time.
    n_calm: u64,
}

impl Spell {
    /// How often it was in all.
    pub fn n(&self) -> u64 {
        self.n
    }

    /// It was, so many times. Returns whether that begins a spell.
    pub fn count(&mut self, n: u64) -> bool {
        let begins = self.lasting.is_none();
        let n_before = self.lasting.map_or(0, |lasting| lasting.n);
        self.lasting = Some(Lasting { n: n_before + n, n_calm: 0 });
        self.n += n;
        begins
    }

    /// A message came without it. Returns how often it was in the spell that this ends.
    pub fn calm(&mut self) -> Option<u64> {
        let lasting = self.lasting.as_mut()?;
        lasting.n_calm += 1;
        let ended = (lasting.n_calm == CALM_MESSAGES).then_some(lasting.n);
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
    fn a_spell_begins_once_and_ends_after_a_hundred_messages_without_it() {
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

    #[test]
    fn a_trouble_begins_and_ends_once_however_often_it_happens() {
        let mut spell = Spell::default();
        assert_eq!(spell.calm(), None);
        for n_before in [0, 5] {
            assert!(spell.count(2));
            assert!((1..CALM_MESSAGES).all(|_| spell.calm().is_none()));
            assert!(!spell.count(3));
            assert!((1..CALM_MESSAGES).all(|_| spell.calm().is_none()));
            assert_eq!(spell.calm(), Some(5));
            assert_eq!(spell.calm(), None);
            assert_eq!(spell.n(), n_before + 5);
        }
    }
}
