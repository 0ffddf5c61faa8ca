//! What a person should know about a model's graph and kinds: islands, evidence that does not agree or ends where the search did, one kind
//! that has nearly all frames, and fits that were given up.

use kinds_model::evidence::{N_KINDS_TRIED_MAX, best_by_bic_neff, best_by_held_out};
use kinds_model::{KindsBy, KindsTrial, Manifest, Method, Model, Provenance};

/// Share of the frames beyond which a kind is a giant.
const GIANT_SHARE: f64 = 0.8;

/// Where the neighbour graph had to be joined; none where it was in one piece.
pub(crate) fn remark_on_islands(model: &Model) -> Option<String> {
    let Manifest { n_neighbors, provenance, .. } = model.manifest();
    let lengths: Vec<f32> = provenance.bridges.iter().map(|(_, _, length)| *length).collect();
    on_islands(*n_neighbors, &provenance.islands, &lengths)
}

/// Sentences about a model's kinds; none where all is well.
pub(crate) fn remarks_on_kinds(model: &Model) -> Vec<String> {
    let Manifest { plan, n_trained, n_kinds, provenance, .. } = model.manifest();
    let mut remarks = Vec::new();
    if plan.n_kinds.is_none() {
        remarks.extend(on_number(*n_kinds, plan.kinds_by, &provenance.kinds_tried));
        remarks.extend(on_end_of_trials(&provenance.kinds_tried, *n_trained));
    }
    remarks.extend(match plan.method {
        Method::Native => Some(on_native_space(*n_kinds, provenance.largest_kind_share)),
        _ => on_giant(*n_kinds, provenance.largest_kind_share),
    });
    remarks.extend(on_fit(provenance, plan.em.n_starts));
    remarks
}

/// * `islands` — frames on each
/// * `bridges` — lengths, counts
fn on_islands(n_neighbors: usize, islands: &[usize], bridges: &[f32]) -> Option<String> {
    if islands.len() < 2 {
        return None;
    }
    const N_NAMED: usize = 5;
    let list = |all: Vec<String>| {
        let more = all.len().saturating_sub(N_NAMED);
        let named = all.into_iter().take(N_NAMED).collect::<Vec<_>>().join(", ");
        if more > 0 { format!("{named} and {more} more") } else { named }
    };
    let sizes = list(islands.iter().map(usize::to_string).collect());
    let lengths = list(bridges.iter().map(|length| format!("{length:.0}")).collect());
    let joined_by = match bridges.len() {
        1 => "a bridge".to_string(),
        n_bridges => format!("{n_bridges} bridges"),
    };
    Some(format!(
        "neighbour graph has {} islands ({sizes} frames) at {n_neighbors} neighbours; joined by {joined_by} of {lengths} counts; \
         raise the neighbours to avoid them",
        islands.len(),
    ))
}

/// Where the evidence for the number of kinds does not agree, or chooses an end of what was tried.
fn on_number(n_kinds: usize, by: KindsBy, tried: &[KindsTrial]) -> Option<String> {
    if n_kinds == 1 {
        return Some(
            "the evidence is for a single kind, which tells no places apart; ask for a number of kinds, try another scale, \
             or record a longer trip"
                .to_string(),
        );
    }
    if n_kinds == N_KINDS_TRIED_MAX {
        return Some(format!(
            "{n_kinds} kinds are the most that are tried, and more may be better still; ask for more to see"
        ));
    }
    let (bic_neff, held_out) = (best_by_bic_neff(tried)?.n_kinds, best_by_held_out(tried)?.n_kinds);
    let spoken_for = if by == KindsBy::HeldOut { held_out } else { bic_neff };
    if spoken_for < n_kinds {
        let word = if spoken_for == 1 { "kind" } else { "kinds" };
        return Some(format!(
            "the evidence is for {spoken_for} {word}, and the model has {n_kinds}, the fewest that kinds_min allows"
        ));
    }
    let told = match by {
        _ if bic_neff == held_out => return None,
        KindsBy::HeldOut => format!(
            "blocks that were held out are likeliest at {held_out}, which the model has, and BIC_neff is least at {bic_neff}"
        ),
        _ => format!(
            "BIC_neff is least at {bic_neff}, which the model has, and blocks that were held out are likeliest at {held_out}"
        ),
    };
    Some(format!("the evidence for the number of kinds does not agree: {told}"))
}

/// Where fewer numbers were tried than might have been, because every start lost a kind or there are too few frames.
fn on_end_of_trials(tried: &[KindsTrial], n_frames: usize) -> Option<String> {
    let n_kinds_max = tried.last()?.n_kinds;
    (n_kinds_max < N_KINDS_TRIED_MAX).then(|| {
        format!(
            "no more than {n_kinds_max} kinds were tried: {n_frames} frames kept no more apart from any start; record a \
             longer trip to try more"
        )
    })
}

/// One giant kind is consistent and useless.
fn on_giant(n_kinds: usize, largest_kind_share: f64) -> Option<String> {
    (n_kinds > 1 && largest_kind_share > GIANT_SHARE).then(|| {
        format!(
            "one kind has {:.0} % of the frames, which is consistent and useless: it tells hardly any places apart; ask for \
             more kinds or try another scale",
            100.0 * largest_kind_share
        )
    })
}

/// How much of the trips is of one kind, where nothing was embedded.
fn on_native_space(n_kinds: usize, largest_kind_share: f64) -> String {
    let largest = match n_kinds {
        1 => "all frames are of one kind".to_string(),
        _ => format!("the largest of {n_kinds} kinds has {:.1} % of the frames", 100.0 * largest_kind_share),
    };
    let advice = match largest_kind_share > GIANT_SHARE {
        true => "; one giant kind is consistent and useless: use isomap",
        false => "",
    };
    format!("in native space {largest}{advice}")
}

/// Where a mixture stopped early, or began with starts that came to nothing.
fn on_fit(provenance: &Provenance, n_starts: usize) -> Vec<String> {
    let Provenance { n_iterations, converged, n_starts_collapsed, .. } = provenance;
    let mut remarks = Vec::new();
    if !converged {
        remarks.push(format!("the mixture had not converged after {n_iterations} iterations"));
    }
    if *n_starts_collapsed > 0 {
        let were = if *n_starts_collapsed == 1 { "was" } else { "were" };
        remarks.push(format!(
            "{n_starts_collapsed} of {n_starts} starts of the mixture {were} given up because a kind lost its frames; fewer \
             kinds avoid it"
        ));
    }
    remarks
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Trials of 1, 2, … kinds with these values of BIC_neff and held-out likelihood.
    fn trials(bic_neff: &[f64], held_out: &[f64]) -> Vec<KindsTrial> {
        (1..)
            .zip(bic_neff.iter().zip(held_out))
            .map(|(n_kinds, (&bic_neff, &held_out))| KindsTrial {
                n_kinds,
                log_likelihood: 0.0,
                bic: 0.0,
                caic: 0.0,
                bic_neff,
                held_out,
                n_starts_collapsed: 0,
            })
            .collect()
    }

    #[test]
    fn islands_and_what_joins_them_are_told() {
        assert_eq!(on_islands(10, &[1379], &[]), None);
        assert_eq!(
            on_islands(12, &[1365, 14], &[4991.2]).unwrap(),
            "neighbour graph has 2 islands (1365, 14 frames) at 12 neighbours; joined by a bridge of 4991 counts; raise the \
             neighbours to avoid them"
        );
        assert_eq!(
            on_islands(3, &[90, 5, 4, 3, 2, 1, 1], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).unwrap(),
            "neighbour graph has 7 islands (90, 5, 4, 3, 2 and 2 more frames) at 3 neighbours; joined by 6 bridges of 1, 2, 3, \
             4, 5 and 1 more counts; raise the neighbours to avoid them"
        );
    }

    #[test]
    fn evidence_that_agrees_or_was_not_asked_needs_no_remark() {
        assert_eq!(on_number(2, KindsBy::BicNeff, &trials(&[9.0, 7.0, 8.0], &[-3.0, -1.0, -2.0])), None);
        assert_eq!(on_number(2, KindsBy::Dirichlet, &[]), None);
    }

    #[test]
    fn evidence_for_fewer_kinds_than_there_may_be_is_told() {
        let trials = trials(&[6.0, 7.0, 8.0, 9.0], &[-3.0, -2.0, -1.0, -4.0]);
        assert_eq!(
            on_number(4, KindsBy::BicNeff, &trials).unwrap(),
            "the evidence is for 1 kind, and the model has 4, the fewest that kinds_min allows"
        );
        assert_eq!(
            on_number(4, KindsBy::HeldOut, &trials).unwrap(),
            "the evidence is for 3 kinds, and the model has 4, the fewest that kinds_min allows"
        );
    }

    #[test]
    fn evidence_that_does_not_agree_is_told() {
        let trials = trials(&[9.0, 7.0, 8.0], &[-3.0, -2.0, -1.0]);
        assert_eq!(
            on_number(2, KindsBy::BicNeff, &trials).unwrap(),
            "the evidence for the number of kinds does not agree: BIC_neff is least at 2, which the model has, and blocks \
             that were held out are likeliest at 3"
        );
        assert_eq!(
            on_number(3, KindsBy::HeldOut, &trials).unwrap(),
            "the evidence for the number of kinds does not agree: blocks that were held out are likeliest at 3, which the \
             model has, and BIC_neff is least at 2"
        );
    }

    #[test]
    fn a_number_at_either_end_of_what_was_tried_is_told() {
        for by in [KindsBy::BicNeff, KindsBy::HeldOut, KindsBy::Dirichlet] {
            assert_eq!(
                on_number(1, by, &[]).unwrap(),
                "the evidence is for a single kind, which tells no places apart; ask for a number of kinds, try another \
                 scale, or record a longer trip"
            );
            assert_eq!(
                on_number(20, by, &[]).unwrap(),
                "20 kinds are the most that are tried, and more may be better still; ask for more to see"
            );
        }
    }

    #[test]
    fn trials_that_ended_early_are_told() {
        let falling = [-1.0, -2.0, -3.0, -4.0, -5.0];
        assert_eq!(
            on_end_of_trials(&trials(&falling, &falling), 31).unwrap(),
            "no more than 5 kinds were tried: 31 frames kept no more apart from any start; record a longer trip to try more"
        );
        assert_eq!(on_end_of_trials(&trials(&[0.0; 20], &[0.0; 20]), 31), None);
        assert_eq!(on_end_of_trials(&[], 31), None);
    }

    #[test]
    fn a_giant_among_kinds_is_told() {
        assert_eq!(
            on_giant(3, 0.934).unwrap(),
            "one kind has 93 % of the frames, which is consistent and useless: it tells hardly any places apart; ask for \
             more kinds or try another scale"
        );
        assert_eq!(on_giant(3, 0.8), None);
        assert_eq!(on_giant(1, 1.0), None, "whoever asks for one kind gets it");
    }

    #[test]
    fn native_space_is_told_with_the_share_of_its_largest_kind_and_giants_with_what_to_do() {
        assert_eq!(
            on_native_space(5, 0.2391),
            "in native space the largest of 5 kinds has 23.9 % of the frames"
        );
        assert_eq!(
            on_native_space(5, 0.87),
            "in native space the largest of 5 kinds has 87.0 % of the frames; one giant kind is consistent and useless: use isomap"
        );
        assert_eq!(
            on_native_space(1, 1.0),
            "in native space all frames are of one kind; one giant kind is consistent and useless: use isomap"
        );
    }

    #[test]
    fn a_mixture_that_stopped_early_or_collapsed_is_told() {
        let check = |converged, n_starts_collapsed, expected: &[&str]| {
            let provenance =
                Provenance { n_iterations: 300, converged, n_starts_collapsed, ..Default::default() };
            assert_eq!(on_fit(&provenance, 10), expected);
        };
        check(true, 0, &[]);
        check(false, 0, &["the mixture had not converged after 300 iterations"]);
        let given_up = "given up because a kind lost its frames; fewer kinds avoid it";
        check(true, 1, &[&format!("1 of 10 starts of the mixture was {given_up}")]);
        check(true, 2, &[&format!("2 of 10 starts of the mixture were {given_up}")]);
    }
}
