//! How far what comes has drifted from what the model was learnt from, in words.

use kinds_messages::Drift;

/// Novel frames are many from so many times the usual share on: on second trips through the same place there were 2.6 times as many at
/// most, of a ring that was turned by one reading 5.5 times.
const N_TIMES_NOVEL: f64 = 5.0;

/// Half-split errors are large from so many times the usual one on: on second trips they were 1.09 times at most, of that ring 1.9 times.
const N_TIMES_HALF_SPLIT: f64 = 1.5;

/// What somebody should see to, if anything. Other shares of kinds alone are nothing: a robot may stay in one place.
pub(crate) fn sentence(drift: &Drift) -> Option<String> {
    // What is not known is not a number, which is beyond nothing.
    let is_novel = drift.novel >= N_TIMES_NOVEL * drift.novel_usual;
    let is_apart = drift.half_split >= N_TIMES_HALF_SPLIT * drift.half_split_usual;
    let (novel, novel_usual) = (100.0 * drift.novel, 100.0 * drift.novel_usual);
    let (apart, apart_usual) = (100.0 * drift.half_split, 100.0 * drift.half_split_usual);
    let what = match (is_novel, is_apart) {
        (false, false) => return None,
        (true, false) => format!("{novel:.0} % of the frames are novel ({novel_usual:.0} % usual)"),
        (false, true) => {
            format!("halves of a frame's neighbours place it {apart:.0} % apart ({apart_usual:.0} % usual)")
        }
        (true, true) => format!(
            "{novel:.0} % of the frames are novel ({novel_usual:.0} % usual), and halves of their neighbours place them {apart:.0} % \
             apart ({apart_usual:.0} % usual)"
        ),
    };
    Some(format!(
        "drift: in the last 10 min {what}: look at the sensor; if all is well, kinds update learns from such trips"
    ))
}

/// All numbers in a terminal of 80 columns, with what is usual behind. What is not known yet is a question mark.
pub(crate) fn line(drift: &Drift) -> String {
    let share = |share: f64, usual: f64, n_digits: usize| {
        let number = |share: f64, percent: &str| match share.is_nan() {
            true => "?".to_string(),
            false => format!("{:.n_digits$}{percent}", 100.0 * share),
        };
        format!("{} ({})", number(share, " %"), number(usual, ""))
    };
    format!(
        "10 min (usual)   novel {}   shares {}   halves {}",
        share(drift.novel, drift.novel_usual, 1),
        share(drift.total_variation, drift.total_variation_usual, 0),
        share(drift.half_split, drift.half_split_usual, 0),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drift(novel: f64, half_split: f64) -> Drift {
        Drift {
            n_frames: 3000,
            novel,
            novel_usual: 0.01,
            half_split,
            half_split_usual: 0.14,
            ..Drift::default()
        }
    }

    #[test]
    fn what_is_beyond_the_usual_is_told_in_a_sentence_and_nothing_else_is() {
        let end = ": look at the sensor; if all is well, kinds update learns from such trips";
        for (drift, told) in [
            (Drift::default(), None),
            (drift(f64::NAN, f64::NAN), None),
            (drift(0.049, 0.2), None),
            (Drift { total_variation: 0.9, total_variation_usual: 0.1, ..drift(0.0, 0.14) }, None),
            (drift(0.12, f64::NAN), Some("12 % of the frames are novel (1 % usual)")),
            (drift(0.01, 0.31), Some("halves of a frame's neighbours place it 31 % apart (14 % usual)")),
            (
                drift(0.12, 0.31),
                Some(
                    "12 % of the frames are novel (1 % usual), and halves of their neighbours place them 31 % apart (14 % usual)",
                ),
            ),
        ] {
            let told = told.map(|told| format!("drift: in the last 10 min {told}{end}"));
            assert_eq!(sentence(&drift), told);
        }
    }

    #[test]
    fn a_line_has_all_numbers_and_fits_whatever_they_are() {
        assert_eq!(line(&Drift::default()), "10 min (usual)   novel ? (?)   shares ? (?)   halves ? (?)");
        let usual = Drift { total_variation: 0.231, total_variation_usual: 0.178, ..drift(0.013, 0.145) };
        assert_eq!(line(&usual), "10 min (usual)   novel 1.3 % (1.0)   shares 23 % (18)   halves 14 % (14)");
        let most = Drift {
            total_variation: 1.0,
            total_variation_usual: 1.0,
            half_split_usual: 2.5,
            ..drift(1.0, 2.5)
        };
        assert!(line(&most).chars().count() <= 78, "{}", line(&most));
    }
}
