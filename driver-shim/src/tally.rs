//! What goes wrong now and then with a device's frames.

/// Whole frames in a row after which it is over.
const CALM_FRAMES: u64 = 100;

/// How often something went wrong, told once when it begins and once when it is over.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Tally {
    n: u64,
    /// While it lasts: how many there were before it began, and whole frames since the last.
    lasts: Option<(u64, u64)>,
}

impl Tally {
    /// How often in all.
    pub(crate) fn n(&self) -> u64 {
        self.n
    }

    /// It went wrong so many times more. Returns whether it has only begun.
    pub(crate) fn count(&mut self, n: u64) -> bool {
        let begins = self.lasts.is_none();
        let (n_before, _) = self.lasts.unwrap_or((self.n, 0));
        self.lasts = Some((n_before, 0));
        self.n += n;
        begins
    }

    /// A whole frame has come. Returns how often it went wrong, if it is over with this frame.
    pub(crate) fn frame_came(&mut self) -> Option<u64> {
        let (n_before, n_calm) = self.lasts.as_mut()?;
        *n_calm += 1;
        if *n_calm < CALM_FRAMES {
            return None;
        }
        let n = self.n - *n_before;
        self.lasts = None;
        Some(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trouble_begins_and_ends_once_however_often_it_happens() {
        let mut tally = Tally::default();
        assert_eq!(tally.frame_came(), None);
        for n_before in [0, 5] {
            assert!(tally.count(2));
            assert!((1..CALM_FRAMES).all(|_| tally.frame_came().is_none()));
            assert!(!tally.count(3));
            assert!((1..CALM_FRAMES).all(|_| tally.frame_came().is_none()));
            assert_eq!(tally.frame_came(), Some(5));
            assert_eq!(tally.frame_came(), None);
            assert_eq!(tally.n(), n_before + 5);
        }
    }
}
