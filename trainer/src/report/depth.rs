//! Canonical views of cameras, as images.

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use kinds_model::SensorLayout;

use super::canonical::{DIFFERENCE_SHARE_MIN, View, Views};
use super::drawing::{Drawing, WIDTH_MAX};
use super::views::panel;

const GAP_PX: f64 = 14.0;
const IMAGE_WIDTH_PX: f64 = (WIDTH_MAX - GAP_PX) / 2.0;
const TOP_PX: f64 = 42.0;
/// Name of an image, above it.
const NAME_PX: f64 = 20.0;

/// 256 colours, red, green, blue and opacity.
type Ramp = [[u8; 4]; 256];

/// Near is light and warm, far is dark and blue: lightness alone tells the range, in grey print and to every eye.
const RANGE_STOPS: [[f64; 4]; 4] = [
    [255.0, 240.0, 200.0, 255.0],
    [226.0, 146.0, 96.0, 255.0],
    [120.0, 72.0, 120.0, 255.0],
    [18.0, 24.0, 64.0, 255.0],
];

/// Nearer is orange, farther is blue, no difference lets the paper through: right on white and on black.
const DIFFERENCE_STOPS: [[f64; 4]; 5] = [
    [200.0, 90.0, 0.0, 255.0],
    [220.0, 130.0, 30.0, 128.0],
    [128.0, 128.0, 128.0, 0.0],
    [60.0, 140.0, 200.0, 128.0],
    [0.0, 105.0, 180.0, 255.0],
];

/// Certain lets the paper through, spread is violet.
const SPREAD_STOPS: [[f64; 4]; 3] =
    [[128.0, 128.0, 128.0, 0.0], [160.0, 110.0, 180.0, 128.0], [130.0, 50.0, 160.0, 255.0]];

/// A ramp of colours, and the numbers at its ends.
struct Scale {
    ramp: Ramp,
    low: f64,
    high: f64,
}

struct Scales {
    range: Scale,
    difference: Scale,
    spread: Scale,
}

/// Legend, a panel for each kind, and how to read them.
pub(super) fn draw(layout: SensorLayout, views: &Views) -> (Drawing, Vec<Drawing>, String) {
    let scales = Scales::of(views);
    let panels = views.of_kinds.iter().map(|view| images(layout, view, &scales)).collect();
    let how = "For each kind: its mean image; the mean less that of all frames, blue where the kind sees farther, orange where \
               it sees nearer; the medoid; and the spread, half the way between one standard deviation below and above the mean."
        .to_string();
    (legend(&scales, views.unit.name()), panels, how)
}

impl Scales {
    /// The same for all kinds, so that they can be compared.
    fn of(views: &Views) -> Self {
        let all = |numbers: fn(&View) -> Vec<f64>| -> Vec<f64> {
            let mut all: Vec<f64> = views.of_kinds.iter().flat_map(numbers).collect();
            all.sort_by(f64::total_cmp);
            all
        };
        let at = |sorted: &[f64], share: f64| sorted[((sorted.len() - 1) as f64 * share).round() as usize];
        let ranges = all(|view| view.mean.iter().chain(&view.medoid).copied().collect());
        // A few pixels of thousands may be off the scale: what the others show is worth more.
        let differences = all(|view| view.difference.iter().map(|difference| difference.abs()).collect());
        let spreads = all(|view| spread(view).collect());
        // Of a single kind nothing but rounding is left: that is not to be seen in full colours.
        let largest = at(&differences, 0.995).max(DIFFERENCE_SHARE_MIN * at(&ranges, 1.0));
        let widest = at(&spreads, 0.995);
        Self {
            range: Scale { ramp: ramp(&RANGE_STOPS), low: at(&ranges, 0.0), high: at(&ranges, 1.0) },
            difference: Scale { ramp: ramp(&DIFFERENCE_STOPS), low: -largest, high: largest },
            spread: Scale { ramp: ramp(&SPREAD_STOPS), low: 0.0, high: widest },
        }
    }
}

impl Scale {
    fn index(&self, value: f64) -> u8 {
        let length = (self.high - self.low).max(f64::MIN_POSITIVE);
        // `as` saturates: numbers off the scale have the colour of its end.
        (255.0 * (value - self.low) / length).round() as u8
    }

    fn image(&self, columns: u32, rows: u32, values: impl Iterator<Item = f64>) -> String {
        let indices: Vec<u8> = values.map(|value| self.index(value)).collect();
        data_uri(&png(columns, rows, &indices, &self.ramp))
    }
}

fn spread(view: &View) -> impl Iterator<Item = f64> {
    view.around.iter().map(|(low, high)| (high - low) / 2.0)
}

fn images(layout: SensorLayout, view: &View, scales: &Scales) -> Drawing {
    let (rows, columns) = (layout.rows, layout.columns);
    let image_height_px = IMAGE_WIDTH_PX * f64::from(rows) / f64::from(columns);
    let row_px = image_height_px + NAME_PX + GAP_PX;
    let mut drawing = panel((WIDTH_MAX, TOP_PX + 2.0 * row_px - NAME_PX - GAP_PX + 2.0), view);
    let of_mean = |scale: &Scale, values: &[f64]| scale.image(columns, rows, values.iter().copied());
    let images = [
        ("mean".to_string(), of_mean(&scales.range, &view.mean)),
        ("difference".to_string(), of_mean(&scales.difference, &view.difference)),
        (format!("medoid, frame {}", view.medoid_frame), of_mean(&scales.range, &view.medoid)),
        ("spread".to_string(), scales.spread.image(columns, rows, spread(view))),
    ];
    for (index, (name, data)) in images.iter().enumerate() {
        let x = (index % 2) as f64 * (IMAGE_WIDTH_PX + GAP_PX);
        let y = TOP_PX + (index / 2) as f64 * row_px;
        drawing.text((x, y - 6.0), "quiet", name);
        drawing.image((x, y), (IMAGE_WIDTH_PX, image_height_px), data);
        drawing.frame((x, y), (IMAGE_WIDTH_PX, image_height_px));
    }
    drawing
}

fn legend(scales: &Scales, unit: &str) -> Drawing {
    const BAR_PX: (f64, f64) = (124.0, 12.0);
    let mut drawing = Drawing::new(WIDTH_MAX, 54.0, "legend: colours of range, difference and spread");
    let bars = [("range", &scales.range), ("difference", &scales.difference), ("spread", &scales.spread)];
    let indices: Vec<u8> = (0..=255).collect();
    for (index, (name, scale)) in bars.into_iter().enumerate() {
        let x = index as f64 * (BAR_PX.0 + 24.0);
        drawing.text((x, 13.0), "quiet", &format!("{name}, {unit}"));
        drawing.image((x, 20.0), BAR_PX, &data_uri(&png(256, 1, &indices, &scale.ramp)));
        drawing.frame((x, 20.0), BAR_PX);
        drawing.text((x, 48.0), "", &short(scale.low));
        drawing.text((x + BAR_PX.0, 48.0), "end", &short(scale.high));
    }
    drawing
}

/// A number with about three digits.
fn short(value: f64) -> String {
    let decimals = if value.abs() >= 100.0 { 0 } else { 2 };
    format!("{value:.decimals$}").replace('-', "−")
}

/// 256 colours on straight lines between the stops.
fn ramp(stops: &[[f64; 4]]) -> Ramp {
    std::array::from_fn(|index| {
        let along = index as f64 / 255.0 * (stops.len() - 1) as f64;
        let (before, share) = ((along as usize).min(stops.len() - 2), along.fract());
        // The last colour is the end of the last line, not the beginning of another.
        let share = if index == 255 { 1.0 } else { share };
        let (from, to) = (stops[before], stops[before + 1]);
        std::array::from_fn(|channel| (from[channel] + share * (to[channel] - from[channel])).round() as u8)
    })
}

/// A PNG of one byte a pixel.
fn png(columns: u32, rows: u32, indices: &[u8], ramp: &Ramp) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, columns, rows);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_palette(ramp.iter().flat_map(|colour| &colour[..3]).copied().collect::<Vec<u8>>());
    encoder.set_trns(ramp.iter().map(|colour| colour[3]).collect::<Vec<u8>>());
    encoder.set_compression(png::Compression::High);
    let mut writer = encoder.write_header().expect("memory takes all that is written");
    writer.write_image_data(indices).expect("there is an index for each pixel");
    writer.finish().expect("memory takes all that is written");
    file
}

fn data_uri(png: &[u8]) -> String {
    format!("data:image/png;base64,{}", BASE64_STANDARD.encode(png))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_decodes_to_the_colours_of_its_numbers() {
        let scale = Scale { ramp: ramp(&RANGE_STOPS), low: 1.0, high: 2.0 };
        let values = [1.0, 2.0, 1.5, 0.0, 9.0, 1.25];
        let uri = scale.image(3, 2, values.into_iter());
        let file = BASE64_STANDARD.decode(uri.strip_prefix("data:image/png;base64,").unwrap()).unwrap();
        let mut decoder = png::Decoder::new(std::io::Cursor::new(file));
        decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::ALPHA);
        let mut reader = decoder.read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height), (3, 2));
        let found: Vec<[u8; 4]> = pixels.chunks_exact(4).map(|pixel| pixel.try_into().unwrap()).collect();
        let expected = [0, 255, 128, 0, 255, 64].map(|index: usize| scale.ramp[index]);
        assert_eq!(found, expected);
    }

    #[test]
    fn ramps_begin_and_end_at_their_first_and_last_stops_and_a_range_never_gets_lighter() {
        for stops in [&RANGE_STOPS[..], &DIFFERENCE_STOPS, &SPREAD_STOPS] {
            let ramp = ramp(stops);
            assert_eq!(ramp[0].map(f64::from), stops[0]);
            assert_eq!(ramp[255].map(f64::from), stops[stops.len() - 1]);
        }
        let lightness = |colour: &[u8; 4]| {
            2126 * u32::from(colour[0]) + 7152 * u32::from(colour[1]) + 722 * u32::from(colour[2])
        };
        assert!(ramp(&RANGE_STOPS).windows(2).all(|pair| lightness(&pair[0]) >= lightness(&pair[1])));
    }
}
