//! `kinds name`: what a person calls a kind, in the model's file.

use kinds_model::NameError;

use crate::cli::NameArguments;
use crate::failure::Failure;
use crate::model_file;
use crate::say::mention;

pub(crate) fn run(arguments: &NameArguments) -> Result<(), Failure> {
    let NameArguments { model: path, number, name, note, clear } = arguments;
    let mut model = model_file::open(path)?;
    let named = match clear {
        true => model.clear_kind(*number),
        false => model.name_kind(*number, name.as_deref(), note.as_deref()),
    };
    named.map_err(|error: NameError| Failure::AskedWrongly(error.to_string()))?;
    model_file::write(path, &model)?;
    let record = model.register().kinds().iter().find(|record| record.number == *number);
    let record = record.expect("it has just been named");
    let called =
        if record.name.is_empty() { "has no name".to_string() } else { format!("is {}", record.name) };
    let noted = if record.note.is_empty() { String::new() } else { format!(": {}", record.note) };
    mention(format!("kind {number} of {} {called}{noted}", path.display()))
}
