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
    /// Straight distances; none where the frames have not as many principal components: a remark says so.
    pub pca: Option<Model>,
    /// No embedding.
    pub native: Option<Model>,
    /// The method of the model that these are the rivals of.
    pub own: Method,
    /// Sentences about rivals that there are not.
    pub remarks: Vec<String>,
}

/// Why a model has no rivals.
#[derive(Debug, thiserror::Error)]
#[error("cannot fit Isomap to the model's reference frames for comparison: {0}")]
pub struct RivalError(FitError);

impl Rivals {
    /// Fits the rivals of a model: the methods that it does not use, to its reference frames, each of which counts for all
    /// frames that it stands for ([`refit`]).
    ///
    /// Native space has no dimensions to match: of a model of it, Isomap's rival has as many as the evidence speaks for, and
    /// that of principal components as many as Isomap's.
    ///
    /// Where principal components cannot be fitted with as many dimensions and kinds, the others are compared without them.
    ///
    /// # Errors
    /// If Isomap cannot.
    pub fn of(model: Model, progress: &mut Progress) -> Result<Self, RivalError> {
        let own = model.manifest().plan.method;
        let mut isomap_of = |model: &Model, size| {
            refit(model, Method::Isomap, size, &mut fitting(progress)).map_err(RivalError)
        };
        let (isomap, native) = match own {
            Method::Pca => {
                let isomap = isomap_of(&model, Size::Matched)?;
                return Ok(Self { isomap, pca: Some(model), native: None, own, remarks: Vec::new() });
            }
            Method::Isomap => (model, None),
            Method::Native => (isomap_of(&model, Size::SameKinds)?, Some(model)),
        };
        let pca = refit(&isomap, Method::Pca, Size::Matched, &mut fitting(progress));
        let without = |error| format!("kinds are not compared with those of principal components: {error}");
        let remarks = pca.as_ref().err().map(without).into_iter().collect();
        Ok(Self { isomap, pca: pca.ok(), native, own, remarks })
    }

    /// The model that these are the rivals of.
    pub fn own_model(&self) -> &Model {
        self.models()[self.own_place()].1
    }

    /// The models with their methods: all but the kinds that are drawn at random.
    pub(crate) fn models(&self) -> Vec<(Method, &Model)> {
        let others = [(Method::Pca, &self.pca), (Method::Native, &self.native)];
        let others = others.into_iter().filter_map(|(method, model)| Some((method, model.as_ref()?)));
        [(Method::Isomap, &self.isomap)].into_iter().chain(others).collect()
    }

    /// Which of [`Self::models`] these are the rivals of.
    pub(crate) fn own_place(&self) -> usize {
        let own = self.models().iter().position(|(method, _)| *method == self.own);
        own.expect("a model stands among its rivals")
    }
}

/// Something of each method, all with as many kinds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Methods<T> {
    /// Geodesics.
    pub isomap: T,
    /// Straight distances, in as many dimensions as Isomap; none where there are not as many principal components.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pca: Option<T>,
    /// The readings as they are, if that is the model's method.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub native: Option<T>,
    /// Every frame's kind drawn at random.
    pub random: T,
}

impl<T> Methods<T> {
    /// By name, as a person reads them.
    pub fn named(&self) -> Vec<(&'static str, &T)> {
        let named = [
            ("Isomap", Some(&self.isomap)),
            ("PCA", self.pca.as_ref()),
            ("native space", self.native.as_ref()),
            ("random", Some(&self.random)),
        ];
        named.into_iter().filter_map(|(name, of_it)| Some((name, of_it?))).collect()
    }

    /// From a list.
    ///
    /// * `list` — something with its method, none of what is random: of Isomap, of that, and perhaps of others
    pub(crate) fn from_list(list: impl IntoIterator<Item = (Option<Method>, T)>) -> Self {
        let (mut isomap, mut pca, mut native, mut random) = (None, None, None, None);
        for (method, of_it) in list {
            let place = match method {
                Some(Method::Isomap) => &mut isomap,
                Some(Method::Pca) => &mut pca,
                Some(Method::Native) => &mut native,
                None => &mut random,
            };
            *place = Some(of_it);
        }
        let there = |of: Option<T>| of.expect("Isomap at least, and what is random");
        Self { isomap: there(isomap), pca, native, random: there(random) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_of_a_method_stands_by_its_name_whichever_others_there_are() {
        let [isomap, pca, native] = [Method::Isomap, Method::Pca, Method::Native].map(Some);
        let two = Methods::from_list([(isomap, 1), (None, 3)]);
        assert_eq!(two, Methods { isomap: 1, pca: None, native: None, random: 3 });
        let four = Methods::from_list([(isomap, 1), (pca, 2), (native, 3), (None, 4)]);
        assert_eq!(four.named(), [("Isomap", &1), ("PCA", &2), ("native space", &3), ("random", &4)]);
    }
}
