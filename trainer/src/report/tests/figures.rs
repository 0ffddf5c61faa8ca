//! The figures: their marks, their numbers and their words.

use super::*;

#[test]
fn every_stretch_of_the_path_has_the_colour_and_the_width_of_its_kind() {
    let svg = path().to_svg();
    let document = parse(&svg);
    // Samples of the legend begin at 4 px and run to the side; stretches of the path come after them.
    let is_map = |node: &Node| node.parent().unwrap().children().any(|mark| mark.text() == Some("trip <1>"));
    let mut x_of_kind: BTreeMap<usize, Vec<(f64, f64)>> = BTreeMap::new();
    for kind in 0..2 {
        let style = KindStyle::of(kind);
        for mark in with_class(&document, &style.colour_class()).into_iter().filter(is_map) {
            assert_eq!(mark.attribute("stroke-width"), Some(style.width_px.to_string().as_str()));
            let places: Vec<f64> = mark.attribute("d").unwrap()[1..]
                .split('L')
                .map(|place| place.split(' ').next().unwrap().parse().unwrap())
                .collect();
            x_of_kind.entry(kind).or_default().push((places[0], places[places.len() - 1]));
        }
    }
    // A stretch reaches half way to its neighbours: 0–1.5 m, 1.5–3.5 m and 3.5–4 m.
    let [zero, one] = [&x_of_kind[&0], &x_of_kind[&1]];
    assert_eq!((zero.len(), one.len()), (2, 1));
    let m_px = (one[0].1 - one[0].0) / 2.0;
    let near = |a: f64, b: f64| (a - b).abs() < 0.02;
    assert!(near(zero[0].1, one[0].0) && near(zero[0].1 - zero[0].0, 1.5 * m_px), "{x_of_kind:?}");
    assert!(near(zero[1].0, one[0].1) && near(zero[1].1 - zero[1].0, 0.5 * m_px), "{x_of_kind:?}");
}

#[test]
fn kinds_come_together_as_the_model_says() {
    let ring = ring();
    let figure = kinds_merged(&ring).unwrap();
    let svg = figure.to_svg();
    let document = parse(&svg);
    let merges = &ring.manifest().merges;
    assert_eq!(with_class(&document, "mark").len(), merges.len());
    let rows: Vec<Vec<String>> = (merges.iter().enumerate())
        .map(|(index, (into, from))| [merges.len() - index, *into, *from].map(|n| n.to_string()).to_vec())
        .collect();
    assert_eq!(lines(figure.csv()), rows);
    for kind in 0..ring.mixture().n_kinds() {
        assert!(texts(&svg).contains(&format!("kind {kind}")), "{kind}");
    }
}

#[test]
fn a_metre_is_as_long_across_as_up_whatever_the_trip() {
    for (x_m, y_m) in [(40.0, 3.0), (3.0, 40.0), (5.0, 5.0), (0.0, 0.0)] {
        let corners = [at(0.0, 0.0), at(x_m, 0.0), at(x_m, y_m)];
        let trip =
            TripKinds { title: "trip", seconds: &[], poses: &corners, commands: &[], kinds: &[0, 0, 0] };
        let svg = kinds_on_path("path", "Path", &Register::new(1), &[trip]).to_svg();
        let document = parse(&svg);
        // The first is the legend's.
        let path =
            with_class(&document, "c0").into_iter().next_back().unwrap().attribute("d").unwrap().to_string();
        let places: Vec<(f64, f64)> = path[1..]
            .split('L')
            .filter_map(|place| place.split_once(' '))
            .map(|(x, y)| (x.parse().unwrap(), y.split('h').next().unwrap().parse().unwrap()))
            .collect();
        let (first, last) = (places[0], places[places.len() - 1]);
        let (across, up) = (last.0 - first.0, first.1 - last.1);
        assert!((across * y_m - up * x_m).abs() <= 0.02 * (x_m + y_m), "{x_m} × {y_m} m: {across} × {up} px");
        // Neither axis is longer than there is room for, on paper or on a screen.
        let height: f64 = document.root_element().attribute("height").unwrap().parse().unwrap();
        assert!(height < 700.0, "{x_m} × {y_m} m: {height} px");
    }
}

#[test]
fn a_long_trip_stays_a_light_file() {
    let poses: Vec<Option<Pose>> = (0..2200)
        .map(|index| f64::from(index) / 30.0)
        .map(|turn| at(20.0 * turn.cos() + turn, 20.0 * turn.sin()))
        .collect();
    let kinds: Vec<usize> = (0..2200).map(|index| index / 7 % 20).collect();
    let trip = TripKinds { title: "trip", seconds: &[], poses: &poses, commands: &[], kinds: &kinds };
    let n_bytes = kinds_on_path("path", "Path", &Register::new(20), &[trip]).to_svg().len();
    // Two numbers of up to six characters and two more for each frame, and 100 for each of 315 stretches and the rest.
    assert!(n_bytes < 2200 * 14 + 100 * (315 + 100), "{n_bytes} bytes");
}

#[test]
fn the_strip_has_a_bar_for_each_stretch_in_the_row_and_the_colour_of_its_kind() {
    let svg = along_time().to_svg();
    let document = parse(&svg);
    let bars = |class: &str| {
        let marks = with_class(&document, class);
        assert_eq!(marks.len(), 1);
        let d = marks[0].attribute("d").unwrap();
        let numbers =
            |bar: &str| bar.split([' ', 'h']).map(|number| number.parse().unwrap()).collect::<Vec<f64>>();
        d[1..].split('M').map(numbers).collect::<Vec<_>>()
    };
    let (zero, one) = (bars("c0"), bars("c1"));
    assert_eq!((zero.len(), one.len()), (2, 1));
    // Kind 0 for 0.2 s, kind 1 for 0.2 s, kind 0 for the 0.1 s of its last frame; the first row is above the second.
    let (a, b, c) = (&zero[0], &one[0], &zero[1]);
    assert!((a[2] - b[2]).abs() < 0.05 && (a[2] - 2.0 * c[2]).abs() < 0.05, "{a:?} {b:?} {c:?}");
    assert!((a[0] + a[2] - b[0]).abs() < 0.05 && (b[0] + b[2] - c[0]).abs() < 0.05, "{a:?} {b:?} {c:?}");
    assert!(a[1] == c[1] && a[1] < b[1], "{a:?} {b:?} {c:?}");
}

#[test]
fn tables_of_numbers_have_a_line_for_each_number_drawn() {
    let ring = ring();
    assert_eq!(
        path().csv(),
        "trip,frame,x_m,y_m,kind\ntrip <1>,0,0,2,0\ntrip <1>,1,1,2,0\ntrip <1>,2,2,2,1\ntrip <1>,3,3,2,1\ntrip <1>,4,4,2,0\n"
    );
    assert_eq!(along_time().csv().lines().nth(3), Some("trip <1>,2,0.2,1"));
    let provenance = &ring.manifest().provenance;
    let found: Vec<f64> = lines(residual_variance(&[("Isomap", &ring)]).csv())
        .iter()
        .map(|line| line[2].parse().unwrap())
        .collect();
    assert_eq!(found, provenance.residual_variance);
    let found: Vec<f64> = lines(spectrum(&ring).csv()).iter().map(|line| line[1].parse().unwrap()).collect();
    assert_eq!(found, provenance.eigenvalues);
    assert_eq!(lines(canonical_views(&ring).csv()).len(), 3 * 16);
    assert_eq!(
        consistency("consistency", "Consistency", &scores()).csv(),
        "method,n_dims,n_kinds,consistency,chance,kappa,ami,largest_kind_share,area,chance_area,consistency_low,consistency_high,\
         kappa_low,kappa_high,ami_low,ami_high\n\
         Isomap,8,5,0.8,0.2,0.7500000000000001,0.5,0.375,0.7,0.25,0.7000000000000001,0.9,0.4,0.8,0.45,0.55\n\
         PCA,8,5,0.6,0.2,0.49999999999999994,0.5,0.375,0.7,0.25,0.5,0.7,0.4,0.8,0.45,0.55\n\
         random,0,5,0.2,0.25,-0.06666666666666665,0.5,0.375,0.7,0.25,,,,,,\n"
    );
    assert_eq!(
        lines(surfaces().csv())[3..6],
        [
            ["Isomap", "0.4", "0", "1", "0.25", "1"],
            ["Isomap", "0.4", "0.3333333333333333", "0.5", "0.25", "0.3333333333333333"],
            ["Isomap", "0.4", "0.6666666666666666", "0.1", "0.25", "-0.19999999999999998"],
        ]
    );
    assert_eq!(lines(surfaces().csv()).len(), 3 * 2 * 3);
    assert_eq!(
        registration().csv(),
        "errors,sigma_m,consistency,kappa,kappa_low,kappa_high\neach pose by itself,0.1,0.5,0.5,0.4,0.6\n\
         the whole trip,0.1,0.5,-0.2,-0.30000000000000004,-0.1\nthe whole trip,0.2,0.5,0.1,0,0.2\n"
    );
    assert_eq!(
        kinds_met("kinds-met", "Which for which", &Register::new(2), ["a", "b"], &[vec![7, 1], vec![0, 0]])
            .csv(),
        "kind,kind_met,n_frames\n0,0,7\n0,1,1\n1,0,0\n1,1,0\n"
    );
}

#[test]
fn every_dot_of_the_embedding_has_the_colour_of_its_most_probable_kind() {
    let model = ring();
    let figure = embedding(&model);
    let svg = figure.to_svg();
    let document = parse(&svg);
    let mut n_expected = [0; 3];
    let mut probabilities = [0.0; 3];
    for place in model.coordinates().chunks_exact(3) {
        model.mixture().posterior(place, &mut probabilities);
        n_expected[most_probable(&probabilities)] += 1;
    }
    for (kind, n_expected) in n_expected.into_iter().enumerate() {
        let clouds = with_class(&document, &KindStyle::of(kind).colour_class());
        let n_dots = |node: &Node| node.attribute("d").unwrap().matches("h0").count();
        // Once in the legend, where it is a line, and then in each of three projections.
        let found: Vec<usize> = clouds[1..].iter().map(n_dots).collect();
        assert_eq!(found, [n_expected; 3], "kind {kind}");
        let of_kind = lines(figure.csv()).iter().filter(|line| line[1] == kind.to_string()).count();
        assert_eq!(of_kind, n_expected, "kind {kind}");
    }
}

#[test]
fn an_embedding_of_few_dimensions_has_fewer_projections() {
    let sensor = SensorLayout { rows: 1, columns: 9, metres_per_count: 0.001 };
    for (n_dims, n_panels) in [(1, 1), (2, 1), (3, 3), (4, 3)] {
        let svg = embedding(&model(sensor, Scale::Range, n_dims, 3)).to_svg();
        let n_names = texts(&svg).iter().filter(|text| text.starts_with("Dimensions")).count();
        assert_eq!(n_names, n_panels, "{n_dims} dimensions");
    }
}

#[test]
fn canonical_views_are_weighted_means_and_spreads_and_medoids_are_of_their_kind() {
    // More kinds than places: kinds overlap, and frames are shared.
    check_canonical_views(usize::MAX, 8);
    check_canonical_views(80, 5);
}

fn check_canonical_views(n_frames_max: usize, n_kinds: usize) {
    let sensor = SensorLayout { rows: 1, columns: 6, metres_per_count: 0.001 };
    let model = model_keeping(n_frames_max, sensor, Scale::Range, 3, n_kinds);
    let references = model.references();
    let views = canonical::Views::of(&model);
    let mut weights = vec![vec![0.0; n_kinds]; 240];
    for (place, weights) in model.coordinates().chunks_exact(3).zip(&mut weights) {
        model.mixture().posterior(place, weights);
    }
    for (kind, view) in views.of_kinds.iter().enumerate() {
        let total: f64 = weights.iter().map(|weights| weights[kind]).sum();
        assert!((view.share - total / 240.0).abs() < 1e-6, "{}", view.share);
        assert_eq!(most_probable(&weights[view.medoid_frame]), kind);
        assert!(references.indices().contains(&(view.medoid_frame as u32)));
        for reading in 0..6 {
            // A frame that is not kept is seen as the one that stands for it.
            let row = |frame: usize| model.frames().row(references.nearest()[frame] as usize);
            let range_m = |frame: usize| f64::from(row(frame)[reading]) * 0.001;
            let weighted = |value: &dyn Fn(usize) -> f64| {
                (0..240).map(|frame| weights[frame][kind] * value(frame)).sum::<f64>() / total
            };
            let mean = weighted(&range_m);
            let deviation = weighted(&|frame| (range_m(frame) - mean).powi(2)).sqrt();
            let of_all = (0..240).map(range_m).sum::<f64>() / 240.0;
            let (low, high) = view.around[reading];
            // Frames that weigh less than a millionth are left out: 240 of them move a mean of metres by less than this.
            for (found, expected) in [
                (view.mean[reading], mean),
                (view.difference[reading], mean - of_all),
                (low, mean - deviation),
                (high, mean + deviation),
                (view.medoid[reading], range_m(view.medoid_frame)),
            ] {
                assert!(
                    (found - expected).abs() < 1e-4,
                    "kind {kind}, reading {reading}: {found}, not {expected}"
                );
            }
        }
    }
    let shares: f64 = views.of_kinds.iter().map(|view| view.share).sum();
    assert!((shares - 1.0).abs() < 1e-4, "{shares}");
}

#[test]
fn rings_are_drawn_as_rays_and_cameras_as_images() {
    let count = |svg: &str, tag: &str| svg.matches(&format!("<{tag} ")).count();
    let (ring, camera) = (canonical_views(&ring()).to_svg(), canonical_views(&camera()).to_svg());
    assert_eq!(count(&ring, "image"), 0);
    // Two rings each of mean and of medoid in every panel: closed lines.
    assert_eq!(ring.matches("z\" class=\"line c").count(), 2 * 3);
    assert_eq!(ring.matches("z\" class=\"dotted").count(), 2 * 3);
    // The medoids of both, and how far the rings are apart.
    let said = |svg: &str, words: &str| texts(svg).into_iter().filter(|text| text.starts_with(words)).count();
    assert_eq!((said(&ring, "medoid: frame "), said(&camera, "medoid, frame ")), (3, 3));
    assert_eq!((said(&ring, "rings: "), said(&ring, "rings: 1 m; the strong one is 0")), (6, 3));
    // Mean, difference, medoid and spread, and three bars of the legend.
    assert_eq!(count(&camera, "image"), 4 * 3 + 3);
    let headings = texts(&camera).into_iter().filter(|text| text.starts_with("kind ")).collect::<Vec<_>>();
    assert_eq!(headings.len(), 3);
    assert!(headings.iter().all(|heading| heading.ends_with("\u{a0}%")), "{headings:?}");
}

#[test]
fn a_single_kind_differs_from_all_frames_by_nothing_that_could_be_seen() {
    let layout = |rows| SensorLayout { rows, columns: 8, metres_per_count: 0.001 };
    let one = |rows| canonical_views(&model(layout(rows), Scale::Inverse, 3, 1)).to_svg();
    // The longest reading is 3.15 m: rings at a round part of its thousandth, not of rounding.
    let rings: Vec<String> =
        texts(&one(2)).into_iter().filter(|text| text.ends_with("the strong one is 0")).collect();
    assert_eq!(rings, ["rings: 0.001 m; the strong one is 0"]);
    assert_eq!(texts(&one(6)).iter().filter(|text| text.chars().count() > 40).count(), 0);
}

#[test]
fn captions_say_how_to_read_a_figure_and_what_it_shows() {
    let check =
        |figure: Figure, expected: &str| assert_eq!(figure.caption().replace('\u{a0}', " "), expected);
    let ring = ring();
    let provenance = &ring.manifest().provenance;
    let (variance, elbow) = (provenance.residual_variance[2], provenance.elbow);
    check(
        residual_variance(&[("Isomap", &ring)]),
        &format!(
            "What the embedding leaves unexplained, by the number of its dimensions. Ring: elbow, where the curve bends. Large dot: dimensions kept. Isomap: bends at {elbow}, 3 kept, which leave {variance:.4}."
        ),
    );
    let negative = 100.0 * ring.manifest().provenance.negative_share;
    check(
        spectrum(&ring),
        &format!(
            "Each eigenvalue is the spread of the landmarks along one dimension, the largest 30 of 60 landmarks; thick: the 3 dimensions kept. Negative eigenvalues hold {negative:.0} % of the sum of all magnitudes: so far are the distances from those of any flat space."
        ),
    );
    check(
        embedding(&ring),
        "All 240 frames in the first 3 of 3 dimensions, each dot with the colour of its most probable kind. Numbers stand at the means of the kinds. Frames near each other looked alike to the robot.",
    );
    check(
        path(),
        "Each stretch of the path has the colour and the width of its kind; the circle is the start. Metres on both axes, on one scale. trip <1>: 5 frames in 3 stretches, 60 % of them of kind 0.",
    );
    check(
        along_time(),
        "When the robot saw which kind: a row for each kind. trip <1>: the kind changed 2 times in 0 s.",
    );
    check(
        consistency("consistency", "Consistency", &scores()),
        "Dot: share of the frames of the first trip, among those that the second came within 0.3 m of, where more than 50 % of the second trip's frames nearby have the same kind. Upright line: the same by chance, which is what remains when the second trip's kinds are shifted in time. Line below the dot: how far it could have come out otherwise (the middle 95 % over resampled blocks of the path). κ is the way from chance to perfection. All at 8 dimensions and 5 kinds.",
    );
    let scale = "The mean weighs every frame with its probability of being of the kind, the medoid is the real frame of the kind that is nearest to it. Means are taken on the scale on which frames are compared and mapped back to metres; readings beyond 4 m stand for 4 m, invalid ones for 4 m.";
    check(
        canonical_views(&ring),
        &format!(
            "Seen from above, ahead is upwards. Left: mean reading of each sensor (the kind's colour; the second row of sensors is dashed), one standard deviation around it (grey), medoid (dotted). Right: mean less that of all frames, outwards from the circle where the kind sees farther, inwards where it sees nearer. Drawn as if the first reading looked ahead and the others followed counter-clockwise at equal angles. {scale}"
        ),
    );
    let thinned = canonical_views(&thinned_ring());
    assert!(
        thinned.caption().contains(
            " The mean weighs every frame (seen as the reference frame nearest to it) with its probability of being of the kind, "
        ),
        "{}",
        thinned.caption()
    );
    check(
        canonical_views(&camera()),
        &format!(
            "For each kind: its mean image; the mean less that of all frames, blue where the kind sees farther, orange where it sees nearer; the medoid; and the spread, half the way between one standard deviation below and above the mean. {scale}"
        ),
    );
}
