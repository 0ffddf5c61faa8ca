//! Frames that are too many to hold: they are read anew for each pass over them.
//!
//! Whoever has them implements [`FrameSource`]; this crate knows no files. A pass works on some frames at a time, on all
//! threads of whoever calls, while one of these reads the next.

use std::convert::Infallible;

use rayon::prelude::*;

use crate::command::{Command, CommandScale, N_COMMAND_COLUMNS};
use crate::comparison::Comparison;
use crate::features::{Extractor, ManyFeatures};
use crate::fit::FitError;
use crate::landmarks;
use crate::model::Model;

/// Frames that are worked on side by side: 10 MB of 19840 readings. What comes out does not depend on it, but which
/// frames are references may ([`crate::ReferenceSet`]).
pub(crate) const N_FRAMES_IN_BATCH: usize = 256;

/// Frames that a thread works on in one go.
pub(crate) const N_FRAMES_AT_ONCE: usize = 16;

/// Raw frames that can be read more than once.
pub trait FrameSource: Send {
    /// Why frames cannot be read.
    type Error: Send;

    /// Frames that every pass reads.
    fn n_frames(&self) -> usize;

    /// Goes back to the first frame.
    ///
    /// # Errors
    /// If that cannot be reached.
    fn rewind(&mut self) -> Result<(), Self::Error>;

    /// Reads the next frame, at most [`Self::n_frames`] since the last [`Self::rewind`]: the same ones in every pass.
    ///
    /// * `counts` — raw counts, shape `(n_readings,)`; overwritten
    ///
    /// # Errors
    /// If it cannot be read, or is not there any more.
    fn read(&mut self, counts: &mut [u16]) -> Result<(), Self::Error>;
}

/// Why no model could be fitted to frames that are read.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StreamError<E> {
    /// They cannot be read.
    #[error("{0}")]
    Read(E),
    /// They make no model.
    #[error(transparent)]
    Fit(#[from] FitError),
}

impl StreamError<Infallible> {
    /// Of frames that are in memory.
    pub(crate) fn of_fitting(self) -> FitError {
        match self {
            Self::Fit(error) => error,
            Self::Read(never) => match never {},
        }
    }
}

/// Frames in memory.
pub(crate) struct InMemory {
    n_readings: usize,
    /// Raw, shape `(n_frames, n_readings)`.
    counts: Vec<u16>,
    next: usize,
}

impl InMemory {
    pub(crate) fn new(n_readings: usize, counts: Vec<u16>) -> Self {
        Self { n_readings, counts, next: 0 }
    }
}

impl FrameSource for InMemory {
    type Error = Infallible;

    fn n_frames(&self) -> usize {
        self.counts.len() / self.n_readings
    }

    fn rewind(&mut self) -> Result<(), Infallible> {
        self.next = 0;
        Ok(())
    }

    fn read(&mut self, counts: &mut [u16]) -> Result<(), Infallible> {
        counts.copy_from_slice(&self.counts[self.next * self.n_readings..][..self.n_readings]);
        self.next += 1;
        Ok(())
    }
}

/// Rows of frames as they are compared, and commands behind them.
pub(crate) struct Stream<'a, E> {
    /// A model whose trained frames come first, each as the reference frame that stands for it.
    pub(crate) before: Option<&'a Model>,
    pub(crate) source: &'a mut dyn FrameSource<Error = E>,
    pub(crate) n_readings: usize,
    pub(crate) comparison: Comparison,
    pub(crate) extractor: Extractor,
    /// Of the frames that have been read, in order, from [`Self::first_with_features`] on; of all after the first pass.
    pub(crate) features: ManyFeatures,
    /// And the command of each frame that the source has.
    pub(crate) commands: Option<(CommandScale, &'a [Command])>,
}

impl<E: Send> Stream<'_, E> {
    pub(crate) fn n_frames(&self) -> usize {
        self.n_before() + self.source.n_frames()
    }

    fn n_before(&self) -> usize {
        self.before.map_or(0, |model| model.references().n_trained())
    }

    /// The first frame whose readings are known: of frames that a model has kept along slow directions they are not.
    pub(crate) fn first_with_features(&self) -> usize {
        if self.comparison.whitening.is_some() { self.n_before() } else { 0 }
    }

    /// Some frames at random that are what a sensor saw, ascending: of those of a model its reference frames, whose readings are
    /// known, and all that are read.
    pub(crate) fn sample(&self, n_sampled: usize, seed: u64) -> Vec<u32> {
        let of_model = match self.before {
            Some(model) if self.first_with_features() == 0 => model.references().indices(),
            _ => &[],
        };
        let (n_before, n_of_model) = (self.n_before() as u32, of_model.len() as u32);
        let sample =
            landmarks::at_random(of_model.len() + self.source.n_frames(), n_sampled, seed).into_iter();
        sample
            .map(|index| of_model.get(index as usize).copied().unwrap_or(n_before + index - n_of_model))
            .collect()
    }

    /// The row of a frame of the model before.
    fn row_before(&self, index: usize) -> Option<&[u16]> {
        let model = self.before?;
        let reference = *model.references().nearest().get(index)?;
        Some(model.frames().row(reference as usize))
    }

    /// Readings, or directions of them, that are compared.
    fn n_compared(&self) -> usize {
        self.comparison.whitening.as_ref().map_or(self.n_readings, |whitening| whitening.n_directions())
    }

    pub(crate) fn n_columns(&self) -> usize {
        self.n_compared() + if self.commands.is_some() { N_COMMAND_COLUMNS } else { 0 }
    }

    /// Goes through all frames in their order.
    ///
    /// * `each` — told the index of a first frame, and the rows of it and of some after it, shape `(n, n_columns)`; may use
    ///   all threads
    ///
    /// # Errors
    /// Of the source.
    pub(crate) fn pass(&mut self, each: &mut (dyn FnMut(usize, &[u16]) + Send)) -> Result<(), E> {
        let (n_frames, n_columns) = (self.n_frames(), self.n_columns());
        let (mut now, mut next) = (Vec::new(), Vec::new());
        self.source.rewind()?;
        self.read(0, &mut now)?;
        let mut first = 0;
        while first < n_frames {
            let first_of_next = first + now.len() / n_columns;
            let (read, ()) = rayon::join(|| self.read(first_of_next, &mut next), || each(first, &now));
            read?;
            std::mem::swap(&mut now, &mut next);
            first = first_of_next;
        }
        Ok(())
    }

    /// Goes through all frames, and copies some.
    ///
    /// * `indices` — of the frames to copy, ascending
    /// * `done` — told the number of frames gone through, now and then
    ///
    /// # Errors
    /// Of the source.
    pub(crate) fn pick(
        &mut self,
        indices: &[usize],
        done: &mut (dyn FnMut(usize) + Send),
    ) -> Result<Vec<u16>, E> {
        let n_columns = self.n_columns();
        let mut picked = Vec::with_capacity(indices.len() * n_columns);
        self.pass(&mut |first, rows| {
            let end = first + rows.len() / n_columns;
            let here = indices.partition_point(|&index| index < first)
                ..indices.partition_point(|&index| index < end);
            for &index in &indices[here] {
                picked.extend_from_slice(&rows[(index - first) * n_columns..][..n_columns]);
            }
            done(end);
        })?;
        Ok(picked)
    }

    /// Goes through all frames, and returns what becomes of each. The same on any number of threads.
    ///
    /// * `init` — memory for a thread that works on some frames
    /// * `of_frame` — given this, the index of a frame and its row, shape `(n_columns,)`
    /// * `done` — told the number of frames finished, now and then
    ///
    /// # Errors
    /// Of the source.
    pub(crate) fn map<W, T: Send>(
        &mut self,
        init: impl Fn() -> W + Sync + Send,
        of_frame: impl Fn(&mut W, u32, &[u16]) -> T + Sync + Send,
        done: &mut (dyn FnMut(usize) + Send),
    ) -> Result<Vec<T>, E> {
        let n_columns = self.n_columns();
        let mut all = Vec::with_capacity(self.n_frames());
        self.pass(&mut |first, rows| {
            let rows = rows.par_chunks_exact(n_columns).enumerate().with_min_len(N_FRAMES_AT_ONCE);
            let of_row = |memory: &mut W, (index, row)| of_frame(memory, (first + index) as u32, row);
            all.par_extend(rows.map_init(&init, of_row));
            done(all.len());
        })?;
        Ok(all)
    }

    /// Reads some frames; none at the end.
    fn read(&mut self, first: usize, rows: &mut Vec<u16>) -> Result<(), E> {
        let last = self.n_frames().min(first + N_FRAMES_IN_BATCH);
        let (n_columns, n_compared) = (self.n_columns(), self.n_compared());
        let (mut raw, mut scratch) = (vec![0; self.n_readings], self.comparison.scratch());
        let mut features = self.extractor.memory();
        rows.resize((last - first) * n_columns, 0);
        for (index, row) in (first..last).zip(rows.chunks_exact_mut(n_columns)) {
            match self.row_before(index) {
                Some(before) => row.copy_from_slice(before),
                None => {
                    let (compared, command) = row.split_at_mut(n_compared);
                    self.source.read(&mut raw)?;
                    self.comparison.map(&raw, &mut scratch, compared);
                    if let Some((scale, commands)) = &self.commands {
                        command.copy_from_slice(&scale.counts(&commands[index - self.n_before()]));
                    }
                }
            }
            // In the first pass; the others see the same frames.
            if self.first_with_features() + self.features.n_frames() == index {
                let readings = self.comparison.readings(&scratch, &row[..n_compared]);
                self.extractor.extract(readings, &mut features);
                self.features.push(&features);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::{AnyMetric, Euclidean};
    use crate::response::{Response, ResponsePlan, Scale};

    #[test]
    fn every_pass_goes_through_all_frames_once_and_in_their_order() {
        for n_frames in [1, 2, N_FRAMES_IN_BATCH - 1, N_FRAMES_IN_BATCH, N_FRAMES_IN_BATCH + 1, 1000] {
            // On a scale of ranges counts are as they were.
            let counts: Vec<u16> = (1..=2 * n_frames as u16).collect();
            let response = Response::new(&ResponsePlan::new(Scale::Range, 60.0), 0.001).unwrap();
            let source = &mut InMemory::new(2, counts.clone());
            let comparison = Comparison { response, whitening: None };
            let extractor = Extractor::new(crate::testing::layout(1, 2), &AnyMetric::Euclidean(Euclidean));
            let features = ManyFeatures::default();
            let mut stream = Stream {
                before: None,
                source,
                n_readings: 2,
                comparison,
                extractor,
                features,
                commands: None,
            };
            let mut passed = Vec::new();
            for _ in 0..2 {
                passed.clear();
                let pass = stream.pass(&mut |first, rows| {
                    assert_eq!(first * 2, passed.len());
                    passed.extend_from_slice(rows);
                });
                pass.unwrap();
                assert_eq!(passed, counts);
            }
            let (mut n_batches, mut n_told) = (0, 0);
            let mapped = stream.map(|| (), |(), index, row| (index, row[1]), &mut |n_done| n_told = n_done);
            let expected: Vec<(u32, u16)> =
                (0..n_frames as u32).map(|index| (index, 2 * (index as u16 + 1))).collect();
            assert_eq!((mapped.unwrap(), n_told), (expected, n_frames));
            let picked = stream.pick(&[0, n_frames / 2, n_frames - 1], &mut |_| n_batches += 1).unwrap();
            let row = |index: usize| [2 * index as u16 + 1, 2 * index as u16 + 2];
            assert_eq!(picked, [row(0), row(n_frames / 2), row(n_frames - 1)].concat());
            assert_eq!(n_batches, n_frames.div_ceil(N_FRAMES_IN_BATCH));
        }
    }
}
