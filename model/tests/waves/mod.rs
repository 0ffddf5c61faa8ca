//! Frames for tests that count what classifying takes.

use kinds_model::SensorLayout;

/// Waves that move and turn, unlike each other in every reading.
pub(crate) fn trip(sensor: SensorLayout, n_frames: usize) -> Vec<u16> {
    let reading = |index: usize| {
        let (frame, reading) = (index / sensor.n_readings(), index % sensor.n_readings());
        let phase = frame as f64 / 15.0;
        (5000.0
            + 3000.0 * (phase + reading as f64 / 90.0).cos() * (phase * 0.3).sin()
            + (index * 7919 % 97) as f64) as u16
    };
    (0..n_frames * sensor.n_readings()).map(reading).collect()
}
