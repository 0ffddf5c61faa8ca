//! What stands on the pages.

use super::*;

#[test]
fn the_page_of_a_training_and_its_evaluation_has_every_section_and_figure_once() {
    let (model, remarks) = (ring(), ["2 frames without any valid reading were left out".to_string()]);
    let mut page = Page::new("Kinds");
    add_model(&mut page, &model, Some(&camera()), &remarks);
    add_trips(&mut page, model.register(), &[TRIP]);
    add_evaluation(&mut page, model.register(), &evaluation());
    let html = page.to_html();
    let document = parse(&html);
    let all = |tag: &str| -> Vec<String> {
        let nodes = document.descendants().filter(|node| node.has_tag_name(tag));
        nodes.filter_map(|node| node.text()).map(|text| text.replace('\u{a0}', " ")).collect()
    };
    assert_eq!(
        all("h2"),
        [
            "The model",
            "How many neighbours",
            "How many dimensions",
            "How many kinds",
            "The kinds",
            "The trips",
            "Consistency",
            "Consistency elsewhere",
            "Every pair of trips, both ways",
        ]
    );
    assert_eq!(all("a"), all("h2"));
    assert_eq!(
        all("h3"),
        [
            "Residual variance",
            "Eigenvalue spectrum",
            "Embedding",
            "What each kind looks like",
            "Which kinds are most alike",
            "Kinds on the path",
            "Kinds along time",
            "Consistency by method",
            "Consistency, whatever counts as a place",
            "Which kinds are taken for which",
            "When poses are off",
            "Consistency by method",
            "Consistency, whatever counts as a place",
            "Which kinds are taken for which",
            "When poses are off",
        ]
    );
    assert_eq!(all("li"), ["2 frames without any valid reading were left out", "third has no poses"]);
    let revisited = "90.0 % of the frames of first were revisited by second within 0.3 m, 10.0 % never. One kind for everything would \
                     always be consistent: read consistency beside chance, κ, adjusted mutual information (AMI) and the share of \
                     the largest kind.";
    let lead = "κ of Isomap less κ of principal components is 0.25 (−0.04 … 0.50 over 12 blocks of the path of 2.5 m each, drawn \
                anew): neither method is ahead for sure.";
    let usual = (model.squared_radii()[120] as f64).sqrt();
    let bridges = format!(
        "The graph had 3 islands, joined by bridges, whose lengths are guesses about how far places are from each other. For comparison: half of the frames have their 8 nearest within {usual:.0} counts."
    );
    let [(a, b, length), _] = model.manifest().provenance.bridges[..] else { panic!("two bridges") };
    assert_eq!(all("td")[..3], [a.to_string(), b.to_string(), format!("{length:.0}")]);
    assert_eq!(
        all("p"),
        [
            "To be known about it:",
            "That each frame has 8 neighbours was given; no other numbers were tried.",
            &bridges,
            "That there are 3 kinds was given; no other numbers were tried.",
            revisited,
            lead,
            // Elsewhere, the same.
            revisited,
            lead,
            "Is each frame of one trip consistent with the frames of the other? The answer differs by the direction, since what one trip saw only once the other may have passed often.",
            "Not compared:",
        ]
    );
    let facts: Vec<(String, String)> = all("dt").into_iter().zip(all("dd")).collect();
    let expected = [
        ("model", model.id().to_string()),
        ("learnt from", "frames of unknown trips".to_string()),
        ("frames", "240".to_string()),
        ("sensor", "16 readings (2 × 8) of 0.001 m a count".to_string()),
        ("compared on", "1 / (range + 0.3 m), up to 4.00 m".to_string()),
        ("compared by", "euclidean distances".to_string()),
        ("method", "Isomap: 8 neighbours, 60 landmarks, 3 dimensions".to_string()),
        ("kinds", "3, each any ellipsoid (full covariances)".to_string()),
        ("made by", format!("{}, seed 1", model.manifest().provenance.made_by)),
    ];
    assert_eq!(facts, expected.map(|(name, value)| (name.to_string(), value)));
}

#[test]
fn a_method_that_kinds_are_not_compared_with_is_missed_in_words() {
    let mut evaluation = evaluation();
    evaluation.pairs.truncate(1);
    let DirectedScores { scores, kappa_lead, surfaces, .. } = &mut evaluation.pairs[0].forward;
    (scores.methods.pca, surfaces.pca, *kappa_lead) = (None, None, None);
    evaluation.remarks = vec!["kinds are not compared with those of <principal components>".to_string()];
    let mut page = Page::new("Kinds");
    add_evaluation(&mut page, &Register::new(2), &evaluation);
    let html = page.to_html();
    assert!(html.contains("<li>kinds are not compared with those of &lt;principal components&gt;</li>"));
    assert!(html.contains("<td>Isomap</td>") && !html.contains("PCA") && !html.contains("κ of Isomap less"));
}

#[test]
fn a_model_that_keeps_some_frames_says_how_many_and_how_well_they_cover_the_others() {
    let thinned = thinned_ring();
    let mut page = Page::new("Kinds");
    add_model(&mut page, &thinned, None, &[]);
    let html = page.to_html();
    let document = parse(&html);
    let values: Vec<&str> = document
        .descendants()
        .filter(|node| node.has_tag_name("dd"))
        .filter_map(|node| node.text())
        .collect();
    let radius = thinned.manifest().provenance.covering_radius;
    assert_eq!(
        values[2],
        format!(
            "240; the model keeps 60 that cover them: none is farther than {radius:.0} counts from the nearest"
        )
    );
    assert!(radius > 0.0);
}

#[test]
fn neighbours_in_time_are_told_beside_the_others() {
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let counts = (0..80 * 16).map(|_| random.random_range(500..3000)).collect();
    let asked = ring().manifest().plan.clone();
    let plan = FitPlan { consecutive_edges: true, n_kinds: Some(1), ..asked };
    let tied = fit(counts, &plan, Origin::default(), &mut |_, _, _| ()).unwrap();
    let mut page = Page::new("Kinds");
    add_model(&mut page, &tied, None, &[]);
    let expected =
        "<dd>Isomap: 8 neighbours and those before and after in time, 60 landmarks, 3 dimensions</dd>";
    assert!(page.to_html().contains(expected), "{}", page.to_html());
}

#[test]
fn the_kinds_of_the_trained_frames_are_dealt_to_the_trips_that_they_came_from() {
    for model in [ring(), thinned_ring()] {
        check_that_kinds_are_dealt_to_trips(&model);
    }
}

fn check_that_kinds_are_dealt_to_trips(model: &Model) {
    let track = |title: &str, n_frames: usize| Track {
        title: title.to_string(),
        seconds: (0..n_frames).map(|index| index as f64).collect(),
        poses: vec![at(1.0, 2.0); n_frames],
        commands: vec![None; n_frames],
    };
    let mut page = Page::new("Kinds");
    add_learnt_trips(&mut page, model, &[track("one", 100), track("two", 140)]);
    let files = page.files();
    let csv = &files.iter().find(|file| file.name == "time.csv").unwrap().contents;
    let mut probabilities = [0.0; 3];
    let mut places = model.coordinates().chunks_exact(3);
    let titles =
        [("one", 100), ("two", 140)].into_iter().flat_map(|(title, n)| (0..n).map(move |n| (title, n)));
    for (line, (title, frame)) in lines(csv).into_iter().zip(titles) {
        model.mixture().posterior(places.next().unwrap(), &mut probabilities);
        let kind = most_probable(&probabilities).to_string();
        assert_eq!(line, [title, &frame.to_string(), &frame.to_string(), &kind]);
    }
    assert!(places.next().is_none());
}

#[test]
fn methods_stand_side_by_side_with_their_sizes_and_how_alike_their_kinds_are() {
    let ring = ring();
    let one = model(ring.layout(), Scale::Inverse, 2, 1);
    let mut page = Page::new("Kinds");
    add_methods(&mut page, &[("Isomap", &ring), ("itself", &ring), ("one kind", &one)]);
    let html = page.to_html();
    let document = parse(&html);
    let rows: Vec<Vec<String>> = document
        .descendants()
        .filter(|node| node.has_tag_name("tr"))
        .map(|row| {
            row.children().filter_map(|cell| cell.text()).map(|text| text.replace('\u{a0}', " ")).collect()
        })
        .collect();
    let left = |model: &Model, n_dims: usize| {
        format!("{:.4}", model.manifest().provenance.residual_variance[n_dims - 1])
    };
    let titles = [
        "method",
        "readings",
        "dimensions",
        "kinds",
        "residual variance",
        "largest kind",
        "a kind lasts",
        "AMI",
    ];
    assert_eq!(rows[0], titles);
    // Half of the frames are of the first place, which is left every 60 frames; places last 60, 40 and 20.
    let lasts = "40.0 frames";
    assert_eq!(rows[1], ["Isomap", "16", "3", "3", &left(&ring, 3), "50.0 %", lasts, "–"]);
    assert_eq!(rows[2], ["itself", "16", "3", "3", &left(&ring, 3), "50.0 %", lasts, "1.00"]);
    assert_eq!(rows[3], ["one kind", "16", "2", "1", &left(&one, 2), "100.0 %", "240.0 frames", "0.00"]);
}

#[test]
fn trips_without_poses_have_a_sentence_instead_of_a_map() {
    let mut page = Page::new("Kinds");
    add_trips(&mut page, &Register::new(2), &[TripKinds { poses: &[None; 5], ..TRIP }]);
    let names: Vec<String> = page.files().into_iter().map(|file| file.name).collect();
    assert_eq!(names, ["report.html", "time.svg", "time.csv"]);
    assert!(
        page.to_html().contains(
            "<p>Nobody knows where the robot was: there is no map without nav_msgs/msg/Odometry or geometry_msgs/msg/PoseStamped.</p>"
        )
    );
}

#[test]
fn what_kinds_are_good_for_is_said_in_words_where_there_is_nothing_to_draw() {
    let nowhere = TripKinds { poses: &[None; 5], commands: &[None; 5], ..TRIP };
    let track = Track {
        title: "trip".to_string(),
        seconds: nowhere.seconds.to_vec(),
        poses: nowhere.poses.to_vec(),
        commands: nowhere.commands.to_vec(),
    };
    let trips = [ClassifiedTrip { space: 0, track, kinds: nowhere.kinds.to_vec(), drift: None }];
    let uses = Uses::of(&trips, 2, &MapPlan { size_m_min: 1.0, radius_m: 0.3 }, 0);
    let mut page = Page::new("Kinds");
    add_uses(&mut page, &Register::new(2), &trips, &uses);
    add_segmentation(&mut page, &Register::new(2), &named());
    let html = page.to_html();
    for words in [
        "there is no map without nav_msgs/msg/Odometry",
        "there are no commands without geometry_msgs/msg/Twist",
        "To the person the same place as elsewhere, to the robot another:",
    ] {
        assert!(html.contains(words), "{words}");
    }
    let names: Vec<String> =
        page.files().into_iter().map(|file| file.name).filter(|name| name.ends_with("svg")).collect();
    assert_eq!(names, ["transitions.svg", "run-lengths.svg", "segmentation.svg"]);
}

#[test]
fn a_list_of_disagreements_ends_where_nobody_reads_on_and_says_how_many_there_are_more() {
    // Each of 25 stretches of the name lasts one frame of another kind.
    let kinds: Vec<usize> = (0..100).map(|frame| usize::from(frame % 4 == 3)).collect();
    let seconds: Vec<f64> = (0..100).map(f64::from).collect();
    let trip = TripKinds { title: "trip", seconds: &seconds, poses: &[], commands: &[], kinds: &kinds };
    let text = "[(from_s: 0, to_s: 100, name: \"hall\")]";
    let agreement = Segmentation::parse(text, SegmentFormat::Ron, &[trip]).unwrap().compare(&[trip], 2);
    let mut page = Page::new("Kinds");
    add_segmentation(&mut page, &Register::new(2), &agreement);
    let html = page.to_html();
    assert_eq!(html.matches("<td>hall</td>").count(), 20);
    assert!(html.contains("And 5 shorter stretches.") && html.contains("<p>Nowhere.</p>"), "{html}");
}
