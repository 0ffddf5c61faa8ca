//! What the robot was told to do.

/// A velocity that the robot was told to move with (REP-103: x forward, turns counter-clockwise).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// Speed forward, metres per second.
    pub forward_m_s: f64,
    /// Turn counter-clockwise, radians per second.
    pub turn_rad_s: f64,
}

impl Command {
    /// From the six velocities of a twist: linear x, y, z, then angular x, y, z.
    ///
    /// `None` where forward or turn is no finite number: robots ignore such a command too.
    pub(crate) fn from_twist([forward_m_s, _, _, _, _, turn_rad_s]: [f64; 6]) -> Option<Command> {
        (forward_m_s.is_finite() && turn_rad_s.is_finite()).then_some(Command { forward_m_s, turn_rad_s })
    }

    /// As the six velocities of a twist.
    pub(crate) fn twist(&self) -> [f64; 6] {
        [self.forward_m_s, 0.0, 0.0, 0.0, 0.0, self.turn_rad_s]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_survives_the_way_to_a_twist_and_back() {
        let command = Command { forward_m_s: 0.25, turn_rad_s: -1.5 };
        assert_eq!(Command::from_twist(command.twist()), Some(command));
    }

    #[test]
    fn what_is_no_velocity_is_no_command() {
        for (forward_m_s, turn_rad_s) in
            [(f64::NAN, 0.0), (0.0, f64::NAN), (f64::INFINITY, 0.0), (0.0, f64::NEG_INFINITY)]
        {
            assert_eq!(Command::from_twist([forward_m_s, 0.0, 0.0, 0.0, 0.0, turn_rad_s]), None);
        }
        // Other axes do not matter: a robot that drives in the plane by speed and turn has none.
        let lost = f64::NAN;
        assert_eq!(
            Command::from_twist([1.0, lost, lost, lost, lost, 2.0]),
            Some(Command { forward_m_s: 1.0, turn_rad_s: 2.0 })
        );
    }
}
