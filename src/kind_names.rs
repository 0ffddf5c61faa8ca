//! What people call the kinds of models in use: services say numbers, and model files have the names.

use std::path::Path;

use kinds_model::{Model, ModelId, Register};

use crate::failure::Failure;
use crate::model_file;

/// The registers of some models.
#[derive(Default)]
pub(crate) struct KindNames(Vec<(ModelId, Register)>);

impl KindNames {
    /// * `models` — their files
    pub(crate) fn read<'a>(models: impl IntoIterator<Item = &'a Path>) -> Result<Self, Failure> {
        let of = |model: Model| (model.id(), model.register().clone());
        let registers = models.into_iter().map(|path| Ok(of(model_file::open(path)?)));
        registers.collect::<Result<_, Failure>>().map(Self)
    }

    /// The name of a kind of the model with an id, if the model is among these and the kind has one.
    pub(crate) fn name(&self, model: [u8; 16], number: u32) -> Option<&str> {
        let (_, register) = self.0.iter().find(|(id, _)| id.0 == model)?;
        let record = register.kinds().iter().find(|record| record.number == number)?;
        (!record.name.is_empty()).then_some(&*record.name)
    }
}
