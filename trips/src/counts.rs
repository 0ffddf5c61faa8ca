//! Metres to counts and back: the table in the crate's documentation, and nothing else.

/// The count of a reading that was no measurement.
pub(crate) const INVALID: u16 = 0;

/// What one count stands for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Unit {
    metres_per_count: f64,
}

impl Unit {
    /// `None` unless the number of metres is finite and above 0.
    pub(crate) fn new(metres_per_count: f64) -> Option<Unit> {
        (metres_per_count.is_finite() && metres_per_count > 0.0).then_some(Unit { metres_per_count })
    }

    pub(crate) fn metres_per_count(self) -> f64 {
        self.metres_per_count
    }

    /// The count that stands for no return when ranges end at `range_m_max`: that range, at most 65535 counts.
    ///
    /// Of a limit that is no positive number (a driver that left it 0 or NaN): 65535.
    pub(crate) fn no_return(self, range_m_max: f32) -> u16 {
        if range_m_max > 0.0 {
            self.nearest(f64::from(range_m_max)).min(f64::from(u16::MAX)) as u16
        } else {
            u16::MAX
        }
    }

    /// The count of a distance: invalid if NaN, negative, or more than 65535 counts; `no_return` if +Inf.
    pub(crate) fn count_of_metres(self, metres: f32, no_return: u16) -> u16 {
        if metres == f32::INFINITY {
            return no_return;
        }
        let count = self.nearest(f64::from(metres));
        // False for NaN too.
        if (0.0..=f64::from(u16::MAX)).contains(&count) { count as u16 } else { INVALID }
    }

    /// The count of a distance in whole millimetres: invalid if more than 65535 counts.
    pub(crate) fn count_of_millimetres(self, millimetres: u16) -> u16 {
        if self.metres_per_count == 0.001 {
            return millimetres;
        }
        let count = self.nearest(f64::from(millimetres) * 0.001);
        if count <= f64::from(u16::MAX) { count as u16 } else { INVALID }
    }

    /// A count in whole millimetres: invalid if more than 65535 of them.
    pub(crate) fn to_millimetres(self, count: u16) -> u16 {
        if self.metres_per_count == 0.001 {
            return count;
        }
        let millimetres = (self.to_metres(count) / 0.001).round();
        if millimetres <= f64::from(u16::MAX) { millimetres as u16 } else { INVALID }
    }

    pub(crate) fn to_metres(self, count: u16) -> f64 {
        f64::from(count) * self.metres_per_count
    }

    fn nearest(self, metres: f64) -> f64 {
        (metres / self.metres_per_count).round()
    }
}

/// The bounds within which a scan's ranges are measurements.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RangeLimits {
    /// Ranges below are invalid. NaN bounds nothing.
    pub(crate) range_m_min: f32,
    /// Ranges above are invalid. A limit that is no positive number bounds nothing.
    pub(crate) range_m_max: f32,
}

impl RangeLimits {
    /// Whether a distance lies outside; +Inf, which is no return and not a distance, does not.
    pub(crate) fn exclude(&self, metres: f32) -> bool {
        metres < self.range_m_min
            || (metres > self.range_m_max && self.range_m_max > 0.0 && metres != f32::INFINITY)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_unit_is_a_positive_number_of_metres() {
        assert!(Unit::new(0.001).is_some());
        for wrong in [0.0, -0.001, f64::NAN, f64::INFINITY] {
            assert_eq!(Unit::new(wrong), None);
        }
    }

    #[test]
    fn metres_become_counts_by_the_table() {
        let check = |metres: f32, expected: u16| {
            assert_eq!(Unit::new(0.001).unwrap().count_of_metres(metres, 4000), expected, "{metres} m");
        };
        check(f32::NAN, 0);
        check(f32::NEG_INFINITY, 0);
        check(-0.5, 0);
        check(-0.0, 0);
        check(0.0, 0);
        check(0.0004, 0);
        check(0.0006, 1);
        check(1.2344, 1234);
        check(65.535, 65535);
        check(65.536, 0);
        check(f32::MAX, 0);
        check(f32::INFINITY, 4000);
    }

    #[test]
    fn no_return_is_the_largest_range() {
        let mm = Unit::new(0.001).unwrap();
        assert_eq!(mm.no_return(4.0), 4000);
        assert_eq!(mm.no_return(100.0), 65535);
        assert_eq!(mm.no_return(f32::INFINITY), 65535);
        assert_eq!(mm.no_return(0.0), 65535);
        assert_eq!(mm.no_return(f32::NAN), 65535);
    }

    #[test]
    fn ranges_outside_the_limits_are_excluded_and_no_return_is_not() {
        let check = |range_m_min: f32, range_m_max: f32, metres: f32, excluded: bool| {
            let limits = RangeLimits { range_m_min, range_m_max };
            assert_eq!(limits.exclude(metres), excluded, "{metres} m in {limits:?}");
        };
        check(0.1, 4.0, 0.1, false);
        check(0.1, 4.0, 0.099, true);
        check(0.1, 4.0, 4.0, false);
        check(0.1, 4.0, 4.001, true);
        check(0.1, 4.0, f32::INFINITY, false);
        // Limits that nobody filled in bound nothing.
        check(0.0, 0.0, 4.0, false);
        check(f32::NAN, f32::NAN, 4.0, false);
    }

    #[test]
    fn millimetres_pass_untouched_at_a_millimetre() {
        let mm = Unit::new(0.001).unwrap();
        assert!((0..=u16::MAX).all(|pixel| mm.count_of_millimetres(pixel) == pixel));
    }

    #[test]
    fn millimetres_are_rounded_in_another_unit_and_invalid_where_they_do_not_fit() {
        let check = |metres_per_count: f64, millimetres: u16, expected: u16| {
            assert_eq!(Unit::new(metres_per_count).unwrap().count_of_millimetres(millimetres), expected);
        };
        check(0.01, 1234, 123);
        check(0.01, 0, 0);
        check(0.0005, 1000, 2000);
        check(0.0005, 32767, 65534);
        check(0.0005, 32768, 0);
    }

    proptest! {
        #[test]
        fn a_count_survives_the_way_to_single_precision_metres_and_back(count: u16, metres_per_count in 1e-4..0.1) {
            let unit = Unit::new(metres_per_count).unwrap();
            prop_assert_eq!(unit.count_of_metres(unit.to_metres(count) as f32, 0), count);
        }
    }
}
