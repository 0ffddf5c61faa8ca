//! The model file's bytes ↔ [`Model`].
//!
//! The container is safetensors; its metadata holds one entry, `manifest`, a [`Manifest`] in RON. The array `digest` is
//! the SHA-256 of the manifest and of every other array with name, type and shape, so that a flipped bit anywhere that
//! matters is found before the first frame, and equal contents have equal bytes and an equal [`ModelId`]. What people call the
//! kinds stands beside it, with a digest of its own: a model that is given a name is the same model.
//!
//! | array | type and shape | |
//! |---|---|---|
//! | `frames` | u16 (n_frames, n_columns) | reference frames on the response's scale, or along slow directions; commands, where they are compared, as two more columns |
//! | `references` | u32 (n_frames) | which of the trained frames they are |
//! | `nearest` | u32 (n_trained) | which of the reference frames each trained frame is nearest to |
//! | `response` | u16 (65536) | what a raw count becomes before it is compared |
//! | `coordinates` | f64 (n_trained, n_dims) | where the trained frames lie in the embedding |
//! | `weights`, `means`, `covariances` | f64 (n_kinds), (n_kinds, n_dims), (n_kinds, n_dims, n_dims) | the kinds |
//! | `squared_radii` | u64 (n_frames) | of each reference frame to its last neighbour, ascending, counts² |
//! | `held_out` | f64 (n_held_out, 4) | what novelty is told by, of frames that were held out ([`novelty`](crate::novelty)) |
//! | `textures` | f64 (n_held_out, 2) | of these frames |
//! | `form_means`, `form_covariance` | f64 (n_tiles), (n_tiles, n_tiles) | what trained frames look like from afar (where that is told) |
//! | `whitening_weights`, `whitening_offsets`, `whitening_scales` | i16 (n_directions, n_readings), f64 (n_directions) twice | slow directions ([`whitening`](crate::whitening); where they are compared) |
//! | `whitening_means`, `whitening_loadings` | f32 (n_readings), (n_directions, n_readings) | what readings change by along them |
//! | `landmarks` | u32 (n_landmarks) | which reference frames geodesics are measured from (not by `native`) |
//! | `projection`, `mean_squared_geodesics` | f64 (n_landmarks, n_dims), (n_landmarks) | P and δ̄ (not by `native`) |
//! | `geodesics` | f32 (n_frames, n_landmarks) | G (`isomap` alone) |
//! | `digest` | u8 (32) | its first 16 bytes are the model's id |
//! | `register` | u8 (n_bytes) | numbers, names and notes of kinds, a [`Register`] in RON |
//! | `register_digest` | u8 (32) | the SHA-256 of `digest` and `register` |

mod error;

use std::collections::HashMap;
use std::sync::Arc;

use bytemuck::Pod;
use bytes::Bytes;
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView};
use serde::Deserialize;
use sha2::{Digest, Sha256};

pub use self::error::ModelFileError;
use crate::array::Array;
use crate::command::N_COMMAND_COLUMNS;
use crate::comparison::Comparison;
use crate::features::Extractor;
use crate::form::Form;
use crate::frames::Frames;
use crate::geodesics::Geodesics;
use crate::hierarchy;
use crate::mds::Embedding;
use crate::mixture::Mixture;
use crate::model::{Manifest, Model, ModelId, N_DIMS_MAX, N_KINDS_MAX};
use crate::novelty::{N_MEASURED, Novelty};
use crate::plan::Method;
use crate::reference::ReferenceSet;
use crate::register::Register;
use crate::response::{Response, TABLE_LEN};
use crate::texture::{N_WAYS, Textures};
use crate::whitening::Whitening;

/// Version of the format that this crate writes and reads.
pub const FORMAT: u32 = 5;

const MANIFEST: &str = "manifest";
const DIGEST: &str = "digest";
const REGISTER: &str = "register";
const REGISTER_DIGEST: &str = "register_digest";

#[cfg(target_endian = "big")]
compile_error!("model files are little-endian and are read where they lie");

/// An array of the file.
struct NamedArray<'a> {
    name: &'static str,
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: &'a [u8],
}

/// Writes a model as the bytes of its file.
pub fn to_bytes(model: &Model) -> Vec<u8> {
    let manifest = manifest_text(&model.manifest);
    let digest = digest(&manifest, &arrays(model));
    let register = register_text(&model.register);
    let register_digest = register_digest(&digest, register.as_bytes());
    let plain = |name, bytes| NamedArray { name, dtype: Dtype::U8, shape: vec![<[u8]>::len(bytes)], bytes };
    let beside = [
        plain(DIGEST, &digest),
        plain(REGISTER, register.as_bytes()),
        plain(REGISTER_DIGEST, &register_digest),
    ];
    let views = arrays(model).into_iter().chain(beside).map(|array| {
        let view = TensorView::new(array.dtype, array.shape, array.bytes);
        (array.name, view.expect("shapes are those of the arrays"))
    });
    let metadata = HashMap::from([(MANIFEST.to_string(), manifest)]);
    safetensors::serialize(views, Some(metadata)).expect("arrays of these types and sizes can be written")
}

/// The id of a model's contents.
pub(crate) fn id_of(model: &Model) -> ModelId {
    id(&digest(&manifest_text(&model.manifest), &arrays(model)))
}

/// Reads a model from the bytes of its file. Arrays stay where they lie in `bytes`, if aligned.
///
/// # Errors
/// If the bytes are cut off, damaged, of another format or of something else, or hold numbers that cannot be.
pub fn from_bytes(bytes: &Bytes) -> Result<Model, ModelFileError> {
    let container = |error: safetensors::SafeTensorError| ModelFileError::Container {
        n_bytes: bytes.len(),
        reason: error.to_string(),
    };
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(container)?;
    let file = File { bytes, tensors: SafeTensors::deserialize(bytes).map_err(container)? };
    let text = header
        .metadata()
        .as_ref()
        .and_then(|metadata| metadata.get(MANIFEST))
        .ok_or(ModelFileError::NoManifest)?;
    let manifest = read_manifest(text)?;
    let model = file.assemble(manifest, text)?;
    check_contents(&model)?;
    Ok(model)
}

fn manifest_text(manifest: &Manifest) -> String {
    ron::ser::to_string_pretty(manifest, ron::ser::PrettyConfig::default()).expect("a manifest is plain data")
}

fn read_manifest(text: &str) -> Result<Manifest, ModelFileError> {
    #[derive(Deserialize)]
    struct Versioned {
        format: u32,
    }
    let unreadable = |error: ron::error::SpannedError| ModelFileError::Manifest { reason: error.to_string() };
    // The version first: another format may have other fields.
    match ron::from_str::<Versioned>(text).map_err(unreadable)?.format {
        FORMAT => ron::from_str(text).map_err(unreadable),
        found => Err(ModelFileError::OtherFormat { found }),
    }
}

fn register_text(register: &Register) -> String {
    ron::ser::to_string_pretty(register, ron::ser::PrettyConfig::default()).expect("a register is plain data")
}

fn register_digest(digest: &[u8; 32], register: &[u8]) -> [u8; 32] {
    Sha256::new().chain_update(digest).chain_update(register).finalize().into()
}

fn digest(manifest: &str, arrays: &[NamedArray]) -> [u8; 32] {
    let mut hash = Sha256::new();
    // Every part is preceded by its length, so that no two contents run together alike.
    let mut part = |bytes: &[u8]| {
        hash.update((bytes.len() as u64).to_le_bytes());
        hash.update(bytes);
    };
    part(manifest.as_bytes());
    for array in arrays {
        part(array.name.as_bytes());
        part(format!("{:?} {:?}", array.dtype, array.shape).as_bytes());
        part(array.bytes);
    }
    hash.finalize().into()
}

fn id(digest: &[u8; 32]) -> ModelId {
    let (first, _) = digest.split_at(16);
    ModelId(first.try_into().expect("16 of 32 bytes"))
}

/// The model's arrays, in the order in which they are digested.
fn arrays(model: &Model) -> Vec<NamedArray<'_>> {
    fn array<'a, T: Pod>(
        name: &'static str,
        dtype: Dtype,
        shape: &[usize],
        numbers: &'a [T],
    ) -> NamedArray<'a> {
        NamedArray { name, dtype, shape: shape.to_vec(), bytes: bytemuck::cast_slice(numbers) }
    }
    let Manifest { plan, n_trained, n_frames, n_dims, n_kinds, novelty, .. } = &model.manifest;
    let (n_trained, n_frames, n_held_out) = (*n_trained, *n_frames, novelty.n_held_out);
    let (n_dims, n_kinds, n_landmarks) = (*n_dims, *n_kinds, plan.n_landmarks);
    let mut arrays = vec![
        array("frames", Dtype::U16, &[n_frames, model.frames.n_columns()], model.frames.counts()),
        array("references", Dtype::U32, &[n_frames], model.references.indices()),
        array("nearest", Dtype::U32, &[n_trained], model.references.nearest()),
        array("response", Dtype::U16, &[TABLE_LEN], model.response().table()),
        array("coordinates", Dtype::F64, &[n_trained, n_dims], &model.coordinates),
        array("weights", Dtype::F64, &[n_kinds], model.mixture.weights()),
        array("means", Dtype::F64, &[n_kinds, n_dims], model.mixture.means()),
        array("covariances", Dtype::F64, &[n_kinds, n_dims, n_dims], model.mixture.covariances()),
        array("squared_radii", Dtype::U64, &[n_frames], &model.squared_radii),
        array("held_out", Dtype::F64, &[n_held_out, N_MEASURED], model.novelty.measured()),
        array("textures", Dtype::F64, &[n_held_out, N_WAYS], model.novelty.textures().all()),
    ];
    if let Some(form) = model.novelty.form() {
        let n_tiles = novelty.n_tiles;
        arrays.extend([
            array("form_means", Dtype::F64, &[n_tiles], form.means()),
            array("form_covariance", Dtype::F64, &[n_tiles, n_tiles], form.covariance()),
        ]);
    }
    if let Some(embedding) = &model.embedding {
        let (projection, means) = (embedding.projection(), embedding.mean_squared_geodesics());
        arrays.extend([
            array("landmarks", Dtype::U32, &[n_landmarks], &model.landmarks),
            array("projection", Dtype::F64, &[n_landmarks, n_dims], projection),
            array("mean_squared_geodesics", Dtype::F64, &[n_landmarks], means),
        ]);
    }
    if let Some(whitening) = model.whitening() {
        let shape = [whitening.n_directions(), whitening.n_readings()];
        arrays.extend([
            array("whitening_weights", Dtype::I16, &shape, &whitening.weights),
            array("whitening_offsets", Dtype::F64, &shape[..1], &whitening.offsets),
            array("whitening_scales", Dtype::F64, &shape[..1], &whitening.scales),
            array("whitening_means", Dtype::F32, &shape[1..], &whitening.means),
            array("whitening_loadings", Dtype::F32, &shape, &whitening.loadings),
        ]);
    }
    if let Some(geodesics) = &model.geodesics {
        arrays.push(array("geodesics", Dtype::F32, &[n_frames, n_landmarks], geodesics.lengths()));
    }
    arrays
}

/// A container whose arrays are asked for by name.
struct File<'a> {
    bytes: &'a Bytes,
    tensors: SafeTensors<'a>,
}

impl File<'_> {
    /// Takes an array of exactly this type and shape.
    fn array<T: Pod + Send>(
        &self,
        name: &str,
        dtype: Dtype,
        shape: &[usize],
    ) -> Result<Array<T>, ModelFileError> {
        let expected = format!("{dtype:?} {shape:?}");
        let wrong =
            |found| ModelFileError::Array { name: name.to_string(), found, expected: expected.clone() };
        let tensor = self.tensors.tensor(name).map_err(|_| wrong("missing".to_string()))?;
        if tensor.dtype() != dtype || tensor.shape() != shape {
            return Err(wrong(format!("{:?} {:?}", tensor.dtype(), tensor.shape())));
        }
        Ok(Array::from_bytes(self.bytes.slice_ref(tensor.data())))
    }

    /// Whether a digest is the one that was written.
    fn check_digest(&self, name: &str, found: &[u8; 32]) -> Result<(), ModelFileError> {
        let written = self.array::<u8>(name, Dtype::U8, &[found.len()])?;
        if written[..] == found[..] {
            return Ok(());
        }
        let hex = |bytes: &[u8]| bytes.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
        Err(ModelFileError::Digest { found: hex(found), written: hex(&written) })
    }

    /// What people call the kinds of the model with this digest.
    fn register(&self, digest: &[u8; 32]) -> Result<Register, ModelFileError> {
        // Of any length.
        let n_bytes = self.tensors.tensor(REGISTER).map_or(0, |tensor| tensor.data().len());
        let text = self.array::<u8>(REGISTER, Dtype::U8, &[n_bytes])?;
        self.check_digest(REGISTER_DIGEST, &register_digest(digest, &text))?;
        ron::de::from_bytes(&text).map_err(|error| ModelFileError::Register { reason: error.to_string() })
    }

    fn whitening(&self, n_directions: usize, n_readings: usize) -> Result<Whitening, ModelFileError> {
        let shape = [n_directions, n_readings];
        Ok(Whitening {
            weights: self.array("whitening_weights", Dtype::I16, &shape)?,
            offsets: self.array("whitening_offsets", Dtype::F64, &shape[..1])?,
            scales: self.array("whitening_scales", Dtype::F64, &shape[..1])?,
            means: self.array("whitening_means", Dtype::F32, &shape[1..])?,
            loadings: self.array("whitening_loadings", Dtype::F32, &shape)?,
        })
    }

    fn form(&self, n_tiles: usize) -> Result<Form, ModelFileError> {
        let means: Array<f64> = self.array("form_means", Dtype::F64, &[n_tiles])?;
        let covariance: Array<f64> = self.array("form_covariance", Dtype::F64, &[n_tiles, n_tiles])?;
        let what = "frames' form is no Gaussian";
        Form::from_parts(&means, &covariance).ok_or(ModelFileError::Contents { what })
    }

    fn assemble(&self, manifest: Manifest, text: &str) -> Result<Model, ModelFileError> {
        let Manifest { ref plan, n_trained, n_frames, n_neighbors, n_dims, n_kinds, novelty, .. } = manifest;
        let n_held_out = novelty.n_held_out;
        let n_landmarks = plan.n_landmarks;
        let n_readings = plan.sensor.n_readings();
        let n_more = if manifest.commands.is_some() { N_COMMAND_COLUMNS } else { 0 };
        let n_directions = plan.whitening.map(|whitening| whitening.n_directions);
        let counts = [n_frames, n_landmarks, n_dims, n_kinds, n_readings, n_neighbors, n_held_out];
        if counts.contains(&0) || n_directions == Some(0) {
            return Err(ModelFileError::Contents {
                what: "manifest announces none of something that it needs",
            });
        }
        let geodesics = match plan.method {
            Method::Isomap => Some(self.array("geodesics", Dtype::F32, &[n_frames, n_landmarks])?),
            Method::Pca | Method::Native => None,
        };
        let (landmarks, embedding) = match plan.method {
            Method::Native => (Vec::new().into(), None),
            _ => {
                let embedding = Embedding::from_parts(
                    n_dims,
                    self.array("projection", Dtype::F64, &[n_landmarks, n_dims])?,
                    self.array("mean_squared_geodesics", Dtype::F64, &[n_landmarks])?,
                );
                let what = "projection does not fit its landmarks";
                let embedding = embedding.ok_or(ModelFileError::Contents { what })?;
                (self.array("landmarks", Dtype::U32, &[n_landmarks])?, Some(embedding))
            }
        };
        let response = Response::from_table(self.array("response", Dtype::U16, &[TABLE_LEN])?);
        let textures = Textures::new(self.array("textures", Dtype::F64, &[n_held_out, N_WAYS])?);
        let whitening = n_directions.map(|n| self.whitening(n, n_readings)).transpose()?;
        let comparison = Comparison {
            response: response.ok_or(ModelFileError::Contents { what: "response has not 65,536 entries" })?,
            whitening: whitening.map(Arc::new),
        };
        let compared = comparison.layout(plan.sensor);
        let metric = plan.metric.compile(compared)?;
        let n_tiles = novelty.n_tiles;
        if n_tiles != 0 && n_tiles != Extractor::new(plan.sensor, &metric).n_tiles() {
            return Err(ModelFileError::Contents {
                what: "frames' form is of other tiles than the sensor's",
            });
        }
        let form = (n_tiles > 0).then(|| self.form(n_tiles)).transpose()?;
        let references = ReferenceSet::from_parts(
            self.array("references", Dtype::U32, &[n_frames])?,
            self.array("nearest", Dtype::U32, &[n_trained])?,
        );
        let mut model = Model {
            id: ModelId([0; 16]),
            metric,
            comparison,
            frames: Frames::with_more_columns(
                compared.n_readings(),
                n_more,
                self.array::<u16>("frames", Dtype::U16, &[n_frames, compared.n_readings() + n_more])?,
            )
            .indexed(compared),
            references,
            landmarks,
            geodesics: geodesics.map(|lengths: Array<f32>| Geodesics::new(n_landmarks, lengths)),
            embedding,
            coordinates: self.array("coordinates", Dtype::F64, &[n_trained, n_dims])?,
            mixture: Mixture::new(
                n_dims,
                self.array("weights", Dtype::F64, &[n_kinds])?.to_vec(),
                self.array("means", Dtype::F64, &[n_kinds, n_dims])?.to_vec(),
                self.array("covariances", Dtype::F64, &[n_kinds, n_dims, n_dims])?.to_vec(),
            )?,
            squared_radii: self.array("squared_radii", Dtype::U64, &[n_frames])?,
            novelty: Novelty::new(
                self.array("held_out", Dtype::F64, &[n_held_out, N_MEASURED])?,
                textures,
                form,
            ),
            register: Register::new(n_kinds),
            manifest,
        };
        let found = digest(text, &arrays(&model));
        self.check_digest(DIGEST, &found)?;
        model.register = self.register(&found)?;
        // Beside both digests and the register.
        if self.tensors.len() != arrays(&model).len() + 3 {
            return Err(ModelFileError::Contents {
                what: "file holds arrays that its manifest does not announce",
            });
        }
        model.id = id(&found);
        Ok(model)
    }
}

/// What the digest cannot vouch for in a file that somebody else's program wrote.
fn check_contents(model: &Model) -> Result<(), ModelFileError> {
    let Manifest {
        plan,
        commands,
        n_trained,
        n_frames,
        n_neighbors,
        n_dims,
        n_kinds,
        persistence,
        merges,
        novelty,
        half_split,
        provenance,
        ..
    } = &model.manifest;
    let trips = &provenance.origin.n_frames;
    let finite = |numbers: &[f64]| numbers.iter().all(|number| number.is_finite());
    let units_m = plan.sensor.metres_per_count;
    let checks = [
        (
            *n_kinds <= N_KINDS_MAX && *n_dims <= N_DIMS_MAX,
            "kinds or dimensions are more than a report holds",
        ),
        (n_neighbors < n_frames, "neighbours are more than its reference frames"),
        (
            trips.is_empty()
                || trips.iter().try_fold(0, |sum: usize, n| sum.checked_add(*n)) == Some(*n_trained),
            "trips have more or fewer frames than it was learnt from",
        ),
        (commands.is_none_or(|scale| scale.is_sound()), "commands have a range or weight that cannot be"),
        (units_m.is_finite() && units_m > 0.0, "sensor has no unit"),
        (model.references.fits(), "reference frames are not among those it was learnt from"),
        (
            model.landmarks.iter().all(|&landmark| (landmark as usize) < *n_frames),
            "landmarks are not reference frames",
        ),
        (
            model
                .geodesics
                .iter()
                .all(|geodesics| geodesics.lengths().iter().all(|length| (0.0..=f32::MAX).contains(length))),
            "geodesics are negative or not finite",
        ),
        (
            model.embedding.iter().all(|embedding| {
                finite(embedding.projection()) && finite(embedding.mean_squared_geodesics())
            }) && finite(&model.coordinates),
            "embedding is not finite",
        ),
        (
            model.embedding.is_some() || *n_dims == plan.sensor.n_readings(),
            "native space has not one dimension for each reading",
        ),
        (model.squared_radii.is_sorted(), "neighbourhood radii do not ascend"),
        ((0.0..1.0).contains(persistence), "persistence of kinds is not a probability below 1"),
        (hierarchy::are_whole(*n_kinds, merges), "kinds are not merged one by one into all"),
        (model.register.fits(*n_kinds), "kinds have numbers, names or notes that cannot be"),
        (
            novelty.false_alarm_rate > 0.0 && novelty.false_alarm_rate < 1.0,
            "rate of false alarms is not between 0 and 1",
        ),
        (
            model.novelty.measured().iter().all(|measure| *measure >= 0.0),
            "measures of held-out frames are negative or not numbers",
        ),
        (
            half_split.is_none_or(|half_split| half_split.is_sound() && model.geodesics.is_some()),
            "half-split errors are of no graph, or without a radius",
        ),
        (finite(model.novelty.textures().all()), "textures of held-out frames are not finite numbers"),
    ];
    match checks.into_iter().find(|(holds, _)| !holds) {
        Some((_, what)) => Err(ModelFileError::Contents { what }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command::{Command, CommandScale, Commands};
    use crate::fit::{fit, fit_with_commands};
    use crate::frames::SensorLayout;
    use crate::half_split::HalfSplitManifest;
    use crate::metric::MetricPlan;
    use crate::model::Origin;
    use crate::plan::FitPlan;
    use crate::response::{ResponsePlan, Scale};

    /// Thirty frames of two trips.
    fn model() -> Model {
        let plan = FitPlan {
            method: Method::Pca,
            n_neighbors: Some(4),
            n_landmarks: 30,
            n_dims: Some(2),
            n_kinds: Some(2),
            ..FitPlan::new(
                SensorLayout { rows: 1, columns: 3, metres_per_count: 0.001 },
                ResponsePlan::new(Scale::Range, 4.0),
                0,
            )
        };
        let counts = (1..91_u32).map(|index| (index * index * 37 % 3001) as u16).collect();
        let origin = Origin { n_frames: vec![12, 18], ..Origin::default() };
        fit(counts, &plan, origin, &mut |_, _, _| ()).unwrap()
    }

    #[test]
    fn numbers_that_cannot_be_are_refused_in_words_though_their_digest_is_right() {
        let refuse = |change: fn(&mut Manifest)| {
            let mut model = model();
            change(&mut model.manifest);
            from_bytes(&Bytes::from(to_bytes(&model))).unwrap_err().to_string()
        };
        assert_eq!(
            refuse(|manifest| manifest.provenance.origin.n_frames = vec![12, 17]),
            "the model's trips have more or fewer frames than it was learnt from; train anew"
        );
        assert_eq!(
            refuse(|manifest| manifest.provenance.origin.n_frames = vec![usize::MAX, 31]),
            "the model's trips have more or fewer frames than it was learnt from; train anew"
        );
        assert_eq!(
            refuse(|manifest| manifest.n_neighbors = 30),
            "the model's neighbours are more than its reference frames; train anew"
        );
        assert_eq!(
            refuse(|manifest| manifest.plan.sensor.metres_per_count = 0.0),
            "the model's sensor has no unit; train anew"
        );
        assert_eq!(
            refuse(|manifest| manifest.plan.metric = MetricPlan::Weighted(vec![1.0; 2])),
            "the model does not fit its own sensor; train anew: metric: 2 weights were given and the sensor has 3 readings; \
             give one weight for each"
        );
        assert_eq!(
            refuse(|manifest| manifest.plan.metric = MetricPlan::Ring { n_rings: 2 }),
            "the model does not fit its own sensor; train anew: metric: 1 × 3 readings are not 2 rings of equal length, each \
             within a row and of at least 2 readings; ask for another number of rings"
        );
        assert_eq!(
            refuse(|manifest| manifest.n_neighbors = 0),
            "the model's manifest announces none of something that it needs; train anew"
        );
        assert_eq!(
            refuse(|manifest| manifest.merges = vec![(1, 0)]),
            "the model's kinds are not merged one by one into all; train anew"
        );
        // This one is of straight distances: it has no graph.
        assert_eq!(
            refuse(|manifest| manifest.half_split = Some(HalfSplitManifest { radius: 1.0, usual: 0.1 })),
            "the model's half-split errors are of no graph, or without a radius; train anew"
        );
        let mut other = model();
        let (mut indices, nearest): (Vec<u32>, Vec<u32>) = ((0..30).collect(), (0..30).collect());
        indices.swap(3, 4);
        other.references = ReferenceSet::from_parts(indices.into(), nearest.into());
        assert_eq!(
            from_bytes(&Bytes::from(to_bytes(&other))).unwrap_err().to_string(),
            "the model's reference frames are not among those it was learnt from; train anew"
        );
    }

    #[test]
    fn a_name_changes_neither_what_a_model_is_nor_its_id_and_a_wrong_byte_in_it_is_seen() {
        let mut model = model();
        let id = model.id();
        model.name_kind(1, Some("doorway"), Some("and the lift")).unwrap();
        let bytes = to_bytes(&model);
        let read = from_bytes(&Bytes::from(bytes.clone())).unwrap();
        assert_eq!((read.id(), read.register()), (id, model.register()));
        assert_eq!(read.register().label(1), "1 (doorway)");
        let place = bytes.windows(7).position(|window| window == b"doorway").expect("it is in there");
        let mut other = bytes;
        other[place] = b'D';
        let words = from_bytes(&Bytes::from(other)).unwrap_err().to_string();
        assert!(words.starts_with("the model file is damaged: its contents have digest "), "{words}");
        model.clear_kind(1).unwrap();
        assert_eq!(to_bytes(&model), to_bytes(&self::model()));
        model.register.kinds[1].number = 0;
        assert_eq!(
            from_bytes(&Bytes::from(to_bytes(&model))).unwrap_err().to_string(),
            "the model's kinds have numbers, names or notes that cannot be; train anew"
        );
    }

    #[test]
    fn native_space_of_other_dimensions_than_readings_is_refused_in_words() {
        let mut model = model();
        (model.landmarks, model.embedding) = (Vec::new().into(), None);
        model.manifest.plan.method = Method::Native;
        assert_eq!(
            from_bytes(&Bytes::from(to_bytes(&model))).unwrap_err().to_string(),
            "the model's native space has not one dimension for each reading; train anew"
        );
    }

    #[test]
    fn commands_that_cannot_be_are_refused_in_words() {
        let commanded = || {
            let of_frames =
                (0..30_u32).map(|index| Command { turn_rad_s: f64::from(index % 5), ..Command::default() });
            let commands = Commands { weight: 0.1, of_frames: of_frames.collect() };
            let Model { manifest, .. } = model();
            let counts = (1..91_u32).map(|index| (index * index * 37 % 3001) as u16).collect();
            let plan = FitPlan { n_kinds: Some(2), ..manifest.plan };
            fit_with_commands(counts, &commands, &plan, manifest.provenance.origin, &mut |_, _, _| ())
                .unwrap()
        };
        let refuse = |change: &dyn Fn(&mut Option<CommandScale>)| {
            let mut model = commanded();
            change(&mut model.manifest.commands);
            from_bytes(&Bytes::from(to_bytes(&model)))
                .map(|model| model.id())
                .map_err(|error| error.to_string())
        };
        assert_eq!(refuse(&|_| ()), Ok(commanded().id()));
        let cannot_be = "the model's commands have a range or weight that cannot be; train anew";
        let with = |scale: &mut Option<CommandScale>, turn| scale.as_mut().unwrap().turn.least = turn;
        assert_eq!(refuse(&|scale| with(scale, f64::NAN)), Err(cannot_be.to_string()));
        assert_eq!(refuse(&|scale| with(scale, 9.0)), Err(cannot_be.to_string()));
        assert_eq!(
            refuse(&|scale| *scale = None).unwrap_err(),
            "the model's array frames is U16 [30, 5]; its manifest announces U16 [30, 3]"
        );
    }

    #[test]
    fn a_manifest_and_arrays_of_other_sizes_are_refused_with_both() {
        let mut bytes = to_bytes(&model());
        // What an integer says of its size in the text does not change that of the text.
        let place = bytes.windows(11).position(|window| window == b"n_kinds: 2,").expect("it is in there");
        bytes[place + 9] = b'3';
        assert_eq!(
            from_bytes(&Bytes::from(bytes)).unwrap_err().to_string(),
            "the model's array weights is F64 [2]; its manifest announces F64 [3]"
        );
    }
}
