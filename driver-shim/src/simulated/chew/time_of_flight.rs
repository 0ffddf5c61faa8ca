//! The camera's electronics: from surfaces to counts.
//!
//! A time-of-flight camera lights the scene with modulated light and takes, per pixel, the phase of what returns. Its
//! range is therefore known up to a whole period; its noise is that of the light counted, its own and the sun's; and a
//! pixel half on an edge sees the sum of two waves (Lange & Seitz 2001, *Solid-state time-of-flight range camera*).
//!
//! Light is in units of what a white surface, met squarely at 1 m in the middle of the image, returns.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::camera::{N_COLUMNS, N_PIXELS, N_ROWS};
use super::picture::{Picture, Surface};
use super::pixel_noise::{Draw, PixelNoise};

/// Metres per count.
pub(super) const METRES_PER_COUNT: f64 = 0.001;
/// Half the wavelength of 20 MHz: farther surfaces look nearer by a multiple of it.
pub(super) const PERIOD_M: f64 = 7.5;
/// No surface farther along its ray returns enough light to be measured, by [`Characteristics::SWISS_RANGER`].
pub(super) const RANGE_M_MAX: f64 = 30.0;

/// Light that a pixel counts without any scene, as noise.
const DARK_LIGHT: f64 = 0.0004;
/// Neighbours differ by an edge if their ranges do by this much.
const EDGE_M: f64 = 0.10;

/// What the camera's electronics do to a range.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Characteristics {
    /// Standard deviation of the range of a surface that returns one unit of light, metres.
    noise_m: f64,
    /// A range less certain than this is not given, metres.
    noise_m_max: f64,
    /// More light than this is not measured.
    light_max: f64,
    /// Share of measurements that go missing.
    dropout_share: f64,
    /// Share of pixels that never measure.
    dead_share: f64,
    /// Largest share of a neighbour in a pixel at an edge.
    mixing: f64,
    /// Whether light enters leaves and blades before it returns.
    enters: bool,
}

impl Characteristics {
    /// Made up after the SR-3000's order of magnitude: 1 cm on a wall at 2 m, some 3 cm at 7 m.
    pub(super) const SWISS_RANGER: Self = Self {
        noise_m: 0.004,
        noise_m_max: 0.10,
        light_max: 1.6,
        dropout_share: 0.002,
        dead_share: 0.001,
        mixing: 0.5,
        enters: true,
    };

    /// Every surface measured, without noise; only the period remains.
    #[cfg(test)]
    pub(super) const PERFECT: Self = Self {
        noise_m: 0.0,
        noise_m_max: 0.10,
        light_max: f64::INFINITY,
        dropout_share: 0.0,
        dead_share: 0.0,
        mixing: 0.0,
        enters: false,
    };
}

/// Sunlight during a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sun {
    /// From the ground to the sun, of length 1.
    pub(super) direction: Vector3<f64>,
    /// Light from a white surface that faces the sun.
    pub(super) light: f64,
}

/// What returns to a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Echo {
    /// Along the ray; 0 where nothing returns.
    range_m: f64,
    /// The camera's own light that returns.
    light: f64,
    /// The sun's.
    sunlight: f64,
    /// How much farther it may have come from.
    depth_m: f64,
}

/// The camera's electronics.
pub(super) struct TimeOfFlight {
    characteristics: Characteristics,
    noise: PixelNoise,
    /// `(N_PIXELS,)`
    is_dead: Vec<bool>,
    /// `(N_PIXELS,)`, of one frame at a time.
    echoes: Vec<Echo>,
}

impl TimeOfFlight {
    /// * `camera_seed` — which pixels are dead: the same on all trips
    /// * `noise_seed` — everything else
    pub(super) fn new(characteristics: Characteristics, camera_seed: u64, noise_seed: u64) -> Self {
        let is_dead = PixelNoise::new(camera_seed)
            .frame(0)
            .take(N_PIXELS)
            .map(|draw| draw.uniform[0] < characteristics.dead_share)
            .collect();
        let echoes = vec![Echo::default(); N_PIXELS];
        Self { characteristics, noise: PixelNoise::new(noise_seed), is_dead, echoes }
    }

    /// Measures `picture`: depths along the optical axis, 0 where a pixel has none.
    ///
    /// * `counts` — `(N_PIXELS,)`, overwritten
    pub(super) fn measure(&mut self, picture: &Picture, sun: &Sun, frame_index: u64, counts: &mut [u16]) {
        let range_per_depth = picture.camera().range_per_depth();
        for ((echo, surface), range_per_depth) in
            self.echoes.iter_mut().zip(picture.surfaces()).zip(range_per_depth)
        {
            *echo = surface.map_or(Echo::default(), |surface| Echo::of(surface, sun, *range_per_depth));
        }
        let draws = self.noise.frame(frame_index);
        for (((pixel, count), range_per_depth), draw) in
            counts.iter_mut().enumerate().zip(range_per_depth).zip(draws)
        {
            let range_m = if self.is_dead[pixel] { None } else { self.range_m(pixel, &draw) };
            // 7.5 m and its noise are far below 65535 counts.
            *count =
                range_m.map_or(0, |range_m| (range_m / range_per_depth / METRES_PER_COUNT).round() as u16);
        }
    }

    /// Range that pixel `pixel` gives, in 0…[`PERIOD_M`].
    fn range_m(&self, pixel: usize, draw: &Draw) -> Option<f64> {
        let Characteristics { noise_m, noise_m_max, light_max, dropout_share, .. } = self.characteristics;
        let Echo { range_m, light, sunlight, .. } = self.mixed(pixel, draw);
        if light + sunlight > light_max || draw.uniform[0] < dropout_share {
            return None;
        }
        let deviation_m = noise_m * (light + sunlight + DARK_LIGHT).sqrt() / light;
        // NaN and infinity, where no light returns, are not certain either.
        let is_certain = deviation_m <= noise_m_max && light > 0.0;
        is_certain.then(|| into_period(range_m + deviation_m * draw.normal))
    }

    /// What returns to a pixel, with a share of a neighbour across an edge: the sum of two waves.
    fn mixed(&self, pixel: usize, draw: &Draw) -> Echo {
        let own = self.entered(pixel, draw);
        let Some(other) = self.across_edge(pixel) else {
            return own;
        };
        let share = self.characteristics.mixing * draw.uniform[2];
        let wave = |echo: &Echo, share: f64| {
            let (sin, cos) = libm::sincos(echo.range_m * (TAU / PERIOD_M));
            (share * echo.light * cos, share * echo.light * sin)
        };
        let (a, b) = (wave(&own, 1.0 - share), wave(other, share));
        let (cos, sin) = (a.0 + b.0, a.1 + b.1);
        Echo {
            range_m: libm::atan2(sin, cos) * (PERIOD_M / TAU),
            light: (cos * cos + sin * sin).sqrt(),
            sunlight: own.sunlight + (other.sunlight - own.sunlight) * share,
            depth_m: own.depth_m,
        }
    }

    /// The echo of a pixel, from somewhere within what it looks at: the deeper, the rarer.
    fn entered(&self, pixel: usize, draw: &Draw) -> Echo {
        let mut echo = self.echoes[pixel];
        if self.characteristics.enters {
            echo.range_m += echo.depth_m * draw.uniform[1] * draw.uniform[1];
        }
        echo
    }

    /// The neighbour to the right or below, the first that is across an edge; none without mixing.
    fn across_edge(&self, pixel: usize) -> Option<&Echo> {
        if self.characteristics.mixing == 0.0 {
            return None;
        }
        let range_m = self.echoes[pixel].range_m;
        let right = (pixel % N_COLUMNS + 1 < N_COLUMNS).then_some(pixel + 1);
        let below = (pixel / N_COLUMNS + 1 < N_ROWS).then_some(pixel + N_COLUMNS);
        [right, below]
            .into_iter()
            .flatten()
            .map(|neighbour| &self.echoes[neighbour])
            .find(|echo| (echo.range_m - range_m).abs() > EDGE_M)
    }
}

impl Echo {
    fn of(surface: &Surface, sun: &Sun, range_per_depth: f64) -> Self {
        let optics = surface.material.optics();
        let range_m = surface.depth_m * range_per_depth;
        let returned = |cosine: f64| optics.reflectance * (cosine + optics.roughness * (1.0 - cosine));
        // The lamps shine forward; their light and the lens's weaken towards the corners, together with the fourth
        // power of the cosine.
        let vignette = 1.0 / (range_per_depth * range_per_depth * range_per_depth * range_per_depth);
        let light = returned(surface.incidence) * vignette / (range_m * range_m);
        let towards_sun = surface.normal.dot(&sun.direction);
        let sunlight = if towards_sun > 0.0 { returned(towards_sun) * sun.light } else { 0.0 };
        Self { range_m, light, sunlight, depth_m: optics.depth_m }
    }
}

/// A range as its phase gives it.
fn into_period(range_m: f64) -> f64 {
    range_m - PERIOD_M * (range_m / PERIOD_M).floor()
}
