//! A model and its rivals: the methods that it does not use, fitted to the same frames at the same size.

use kinds_model::{FitError, Method, Model, Size, refit};
use serde::Serialize;

use crate::progress::{Progress, fitting};

/// A model of either method, with the same frames, landmarks, number of dimensions and number of kinds, and perhaps one of
/// the frames as they are, with the same number of kinds.
#[derive(Clone, Debug)]
pub struct Rivals {
    /// Geodesics.
    pub isomap: Model,
    /// Straight distances.
    pub pca: Model,
    /// No embedding.
    pub native: Option<Model>,
    /// The method of the model that these are the rivals of.
    pub own: Method,
}

/// Why a model has no rivals.
#[derive(Debug, thiserror::Error)]
#[error("cannot fit {method} to the model's reference frames for comparison: {error}")]
pub struct RivalError {
    /// Which method, in words.
    pub method: &'static str,
    /// Why.
    pub error: FitError,
}

impl Rivals {
    /// Fits the rivals of a model: the methods that it does not use, to its reference frames, each of which counts for all
    /// frames that it stands for ([`refit`]).
    ///
    /// Native space has no dimensions to match: of a model of it, Isomap's rival has as many as the evidence speaks for, and
    /// that of principal components as many as Isomap's.
    ///
    /// # Errors
    /// If another method cannot be fitted with as many dimensions and kinds.
    pub fn of(model: Model, progress: &mut Progress) -> Result<Self, RivalError> {
        let own = model.manifest().plan.method;
        let mut isomap_of = |model: &Model, size| {
            refit(model, Method::Isomap, size, &mut fitting(progress))
                .map_err(|error| RivalError { method: "Isomap", error })
        };
        let (isomap, native) = match own {
            Method::Pca => {
                let isomap = isomap_of(&model, Size::Matched)?;
                return Ok(Self { isomap, pca: model, native: None, own });
            }
            Method::Isomap => (model, None),
            Method::Native => (isomap_of(&model, Size::SameKinds)?, Some(model)),
        };
        let pca = refit(&isomap, Method::Pca, Size::Matched, &mut fitting(progress))
            .map_err(|error| RivalError { method: "principal components", error })?;
        Ok(Self { isomap, pca, native, own })
    }

    /// The model that these are the rivals of.
    pub fn own_model(&self) -> &Model {
        match (self.own, &self.native) {
            (Method::Native, Some(native)) => native,
            (Method::Pca, _) => &self.pca,
            _ => &self.isomap,
        }
    }

    /// The models, by method: all but the kinds that are drawn at random.
    pub(crate) fn models(&self) -> Vec<&Model> {
        [&self.isomap, &self.pca].into_iter().chain(&self.native).collect()
    }
}

/// Something of each method, all with as many kinds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Methods<T> {
    /// Geodesics.
    pub isomap: T,
    /// Straight distances, in as many dimensions as Isomap.
    pub pca: T,
    /// The readings as they are, if that is the model's method.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub native: Option<T>,
    /// Every frame's kind drawn at random.
    pub random: T,
}

impl<T> Methods<T> {
    /// By name, as a person reads them.
    pub fn named(&self) -> Vec<(&'static str, &T)> {
        let native = self.native.as_ref().map(|native| ("native space", native));
        [("Isomap", &self.isomap), ("PCA", &self.pca)]
            .into_iter()
            .chain(native)
            .chain([("random", &self.random)])
            .collect()
    }

    /// From a list in the order of [`Rivals::models`], followed by what is random.
    pub(crate) fn from_list(list: Vec<T>) -> Self {
        let mut list = list.into_iter();
        let mut next = || list.next();
        let (isomap, pca, third, fourth) = (next(), next(), next(), next());
        let (native, random) = if fourth.is_some() { (third, fourth) } else { (None, third) };
        let there = |of: Option<T>| of.expect("two models at least, and what is random");
        Self { isomap: there(isomap), pca: there(pca), native, random: there(random) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_three_and_of_four_find_their_names() {
        let three = Methods::from_list(vec![1, 2, 3]);
        assert_eq!(three, Methods { isomap: 1, pca: 2, native: None, random: 3 });
        let four = Methods::from_list(vec![1, 2, 3, 4]);
        assert_eq!(four.named(), [("Isomap", &1), ("PCA", &2), ("native space", &3), ("random", &4)]);
    }
}
