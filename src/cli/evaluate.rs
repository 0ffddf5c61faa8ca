//! What can be asked of `kinds evaluate`.

use std::path::PathBuf;

use clap::Args;
use kinds_trainer::{EvaluationPlan, MapPlan};
use kinds_trips::Selection;

use super::ReadingArguments;
use crate::failure::Failure;

#[derive(Args, Debug)]
#[command(allow_negative_numbers = true)]
pub(crate) struct EvaluateArguments {
    /// The model
    #[arg(value_name = "M.kinds")]
    pub(crate) model: PathBuf,
    /// ROS 2 bags (MCAP) of trips through one space, best the one that the model was learnt from first; any two are compared.
    /// Of a single trip: its map, sequence and commands
    #[arg(required = true, value_name = "TRIP")]
    pub(crate) trips: Vec<PathBuf>,
    /// Trips through another space, where the kinds were not learnt: compared among themselves
    #[arg(long, num_args = 1.., value_name = "TRIP")]
    pub(crate) elsewhere: Vec<PathBuf>,
    /// Frames no farther apart than this saw the same place, metres
    #[arg(long, default_value_t = 0.3, value_name = "R")]
    radius_m: f64,
    /// Frames whose headings differ by more than this did not see the same place, degrees [default: a place is the same from every
    /// side]
    #[arg(long, value_name = "T")]
    heading_deg: Option<f64>,
    /// Strictly more than this share of the frames near a frame must have its kind
    #[arg(long, default_value_t = 0.5, value_name = "Z")]
    share: f64,
    /// Radii that consistency is measured at, evenly spread up to --radius-m-max
    #[arg(long, default_value_t = 20, value_name = "N")]
    radii: usize,
    /// Greatest of them, metres [default: twice --radius-m]
    #[arg(long, value_name = "R")]
    radius_m_max: Option<f64>,
    /// Shares that consistency is measured at, evenly spread from 0 to below 1
    #[arg(long, default_value_t = 20, value_name = "N")]
    shares: usize,
    /// What is smaller is no region of the topological map, metres [default: six times --radius-m]
    #[arg(long, value_name = "M")]
    region_m: Option<f64>,
    /// File to write the mean command of each kind to, in RON: a first-pass policy
    #[arg(long, value_name = "FILE.ron")]
    pub(crate) policy: Option<PathBuf>,
    /// A person's own segmentation of the trips, to compare with the kinds: a table (.csv) with the titles trip, from_s, to_s and
    /// name, or the same as a list in RON (.ron); seconds from a trip's first frame; of a single trip, trip may be left out
    #[arg(long, value_name = "FILE.csv|FILE.ron")]
    pub(crate) segments: Option<PathBuf>,
    /// Resamples of the path that confidence intervals are from; 0 for none
    #[arg(long, default_value_t = 1000, value_name = "N")]
    resamples: usize,
    /// Seed of random kinds, resamples, errors of registration and fits to commands
    #[arg(long, default_value_t = 0, value_name = "N")]
    seed: u64,
    /// Folder to write a report to, made if it is not there: report.html, each figure as SVG with its numbers as CSV, and the
    /// topological map as GraphML and DOT
    #[arg(long, value_name = "DIR")]
    pub(crate) report: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    reading: ReadingArguments,
}

impl EvaluateArguments {
    pub(crate) fn selection(&self, metres_per_count: f64) -> Selection {
        self.reading.selection(Some(metres_per_count))
    }

    pub(crate) fn map_plan(&self) -> Result<MapPlan, Failure> {
        // Places that were never passed twice exactly still are places.
        let radius_m = if self.radius_m > 0.0 { self.radius_m } else { 1e-3 };
        let size_m_min = self.region_m.unwrap_or(6.0 * radius_m);
        match size_m_min.is_finite() && size_m_min >= 0.0 {
            true => Ok(MapPlan { size_m_min, radius_m }),
            false => Err(Failure::AskedWrongly(format!("region_m is {size_m_min}; it must be at least 0 m"))),
        }
    }

    pub(crate) fn plan(&self) -> EvaluationPlan {
        EvaluationPlan {
            radius_m: self.radius_m,
            heading_tolerance_rad: self.heading_deg.map(f64::to_radians),
            share: self.share,
            n_radii: self.radii,
            radius_m_max: self.radius_m_max,
            n_shares: self.shares,
            n_resamples: self.resamples,
            seed: self.seed,
        }
    }
}
