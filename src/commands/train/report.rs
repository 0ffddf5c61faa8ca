//! The page that training leaves: the trips and their kinds, the model, and how it was chosen.

use kinds_trainer::Trained;
use kinds_trainer::report::{Page, add_learnt_trips, add_methods, add_model, method_name};

use crate::commands::train::choices;

pub(super) fn page(trained: &Trained) -> Page {
    let Trained { model, pca, tracks, remarks } = trained;
    let titles: Vec<&str> = tracks.iter().map(|track| track.title.as_str()).collect();
    let mut page = Page::new(&format!("Natural kinds: {}", titles.join(", ")));
    add_learnt_trips(&mut page, model, tracks);
    if let Some(pca) = pca {
        let straight = method_name(&pca.own);
        let of_isomaps_size = format!("{straight} of Isomap's size");
        let matched = pca.matched.iter().map(|matched| (&*of_isomaps_size, matched));
        let models: Vec<_> = [("Isomap", model), (straight, &pca.own)].into_iter().chain(matched).collect();
        add_methods(&mut page, &models);
    }
    let rival = pca.as_ref().map(|pca| &pca.own);
    let remarks: Vec<String> = choices(model).iter().chain(remarks).cloned().collect();
    add_model(&mut page, model, rival, &remarks);
    page
}
