//! Topics are found by type where only one fits, and by name.

use kinds_trips::{Role, Selection, TripReader};

use crate::bag::{
    Bag, Folder, IMAGE, LASER_SCAN, ODOMETRY, POSE_STAMPED, TWIST, TWIST_STAMPED, odometry, pose_stamped,
    read_with, refusal, scan, twist_in, twist_stamped_in,
};

fn frames_from(name: &str) -> Selection {
    Selection { frames_topic: Some(name.to_owned()), ..Selection::default() }
}

fn poses_from(name: &str) -> Selection {
    Selection { poses_topic: Some(name.to_owned()), ..Selection::default() }
}

fn commands_from(name: &str) -> Selection {
    Selection { commands_topic: Some(name.to_owned()), ..Selection::default() }
}

/// A bag with these topics and as many messages on each, a scan, a pose or a command.
fn bag_with(path: &std::path::Path, indexed: bool, topics: &[(&str, &str, &str, u32)]) {
    let options = mcap::WriteOptions::new().emit_summary_records(indexed).emit_message_indexes(indexed);
    let mut bag = Bag::with_options(path, options);
    for &(name, type_name, encoding, n_messages) in topics {
        let id = bag.topic_encoded(name, type_name, encoding);
        for index in 0..n_messages {
            let (stamp, x_m) = ((1000, index), f64::from(index));
            let data = match type_name {
                ODOMETRY => odometry(stamp, x_m),
                POSE_STAMPED => pose_stamped(stamp, x_m),
                TWIST => twist_in(false, x_m, 0.0),
                TWIST_STAMPED => twist_stamped_in(false, stamp, x_m, 0.0),
                _ => scan(stamp, &[1.0]),
            };
            bag.message(id, u64::from(index), &data);
        }
    }
    bag.finish();
}

/// Checks a choice with an index and without.
fn check(topics: &[(&str, &str, &str, u32)], selection: &Selection, expected: &str) {
    for indexed in [true, false] {
        let folder = Folder::new();
        let path = folder.join("trip.mcap");
        bag_with(&path, indexed, topics);
        let outcome = match TripReader::open(&path, selection) {
            Ok(trip) => {
                let commands = trip.commands_topic().map_or(String::new(), |name| format!(" {name}"));
                format!("{} {}{commands}", trip.frames_topic(), trip.poses_topic().unwrap_or("-"))
            }
            Err(error) => error.to_string(),
        };
        let expected = expected.replace("TRIP", &path.display().to_string());
        assert_eq!(outcome, expected.replace("FRAMES", &Role::Frames.types()), "indexed: {indexed}");
    }
}

#[test]
fn topics_are_chosen_by_type_or_by_name_and_else_the_sentence_says_how() {
    let scan = ("/scan", LASER_SCAN, "cdr", 3);
    let left = ("/left", LASER_SCAN, "cdr", 1);
    let odom = ("/odom", ODOMETRY, "cdr", 2);
    let slam = ("/slam", ODOMETRY, "cdr", 9);
    let any = Selection::default();

    check(&[scan], &any, "/scan -");
    check(&[odom, scan], &any, "/scan /odom");
    check(&[odom, scan], &frames_from("/scan"), "/scan /odom");
    check(&[scan, left, odom], &frames_from("/left"), "/left /odom");
    check(&[scan, odom, slam], &poses_from("/slam"), "/scan /slam");
    // A pose beside odometry is a goal or the truth: taken where it is named, or where there is nothing else.
    let truth = ("/ground_truth", POSE_STAMPED, "cdr", 2);
    check(&[scan, odom, truth], &any, "/scan /odom");
    check(&[scan, odom, truth], &poses_from("/ground_truth"), "/scan /ground_truth");
    check(&[scan, truth], &any, "/scan /ground_truth");
    check(&[scan, truth, ("/idle_odom", ODOMETRY, "cdr", 0)], &any, "/scan /ground_truth");
    // Topics that a recorder subscribed to in vain are no candidates.
    check(&[scan, ("/idle", LASER_SCAN, "cdr", 0), ("/idle_odom", ODOMETRY, "cdr", 0)], &any, "/scan -");
    // Nor is what is not CDR.
    check(&[scan, ("/json", LASER_SCAN, "json", 1)], &any, "/scan -");

    check(
        &[scan, left],
        &any,
        "TRIP has 2 topics with frames: /left (sensor_msgs/msg/LaserScan, 1 message), \
         /scan (sensor_msgs/msg/LaserScan, 3 messages); choose one with --frames-topic NAME, or join several \
         with --frames-topic NAME,NAME",
    );
    check(
        &[scan, odom, slam],
        &any,
        "TRIP has 2 topics with poses: /odom (nav_msgs/msg/Odometry, 2 messages), \
         /slam (nav_msgs/msg/Odometry, 9 messages); choose one with --poses-topic NAME",
    );
    check(
        &[scan, odom],
        &frames_from("/scna"),
        "TRIP has no topic /scna, asked for with --frames-topic; it has /odom (nav_msgs/msg/Odometry, 2 messages), \
         /scan (sensor_msgs/msg/LaserScan, 3 messages)",
    );
    check(
        &[scan],
        &poses_from("/odom"),
        "TRIP has no topic /odom, asked for with --poses-topic; it has /scan (sensor_msgs/msg/LaserScan, 3 messages)",
    );
    check(
        &[scan, odom],
        &frames_from("/odom"),
        "/odom (nav_msgs/msg/Odometry, 2 messages) in TRIP cannot give frames, asked for with --frames-topic: that takes \
         messages of type FRAMES",
    );
    check(
        &[scan],
        &poses_from("/scan"),
        "/scan (sensor_msgs/msg/LaserScan, 3 messages) in TRIP cannot give poses, asked for with --poses-topic: that \
         takes messages of type nav_msgs/msg/Odometry or geometry_msgs/msg/PoseStamped",
    );
    check(
        &[odom, ("/chat", "", "json", 1), ("/depth", IMAGE, "cdr", 0)],
        &any,
        "TRIP has no frames: none of its topics has messages of type FRAMES; it has /chat (type unknown encoded as 'json', 1 message), /depth (sensor_msgs/msg/Image, no messages), \
         /odom (nav_msgs/msg/Odometry, 2 messages)",
    );
    check(&[], &any, "TRIP has no frames: it has no topics at all");
    check(
        &[],
        &frames_from("/scan"),
        "TRIP has no topic /scan, asked for with --frames-topic; it has no topics",
    );
}

#[test]
fn commands_are_chosen_as_poses_are_but_of_several_topics_none_is_taken() {
    let scan = ("/scan", LASER_SCAN, "cdr", 3);
    let odom = ("/odom", ODOMETRY, "cdr", 2);
    let told = ("/cmd_vel", TWIST, "cdr", 2);
    let stamped = ("/cmd_vel_stamped", TWIST_STAMPED, "cdr", 1);
    let any = Selection::default();

    check(&[scan, odom, told], &any, "/scan /odom /cmd_vel");
    check(&[scan, stamped], &any, "/scan - /cmd_vel_stamped");
    check(&[scan, told, stamped], &commands_from("/cmd_vel"), "/scan - /cmd_vel");
    check(&[scan, told, ("/idle", TWIST_STAMPED, "cdr", 0)], &any, "/scan - /cmd_vel");
    check(&[scan, ("/json", TWIST, "json", 1)], &any, "/scan -");

    check(&[scan, told, stamped], &any, "/scan -");
    check(
        &[scan],
        &commands_from("/cmd_vel"),
        "TRIP has no topic /cmd_vel, asked for with --commands-topic; it has /scan (sensor_msgs/msg/LaserScan, 3 \
         messages)",
    );
    check(
        &[scan, odom],
        &commands_from("/odom"),
        "/odom (nav_msgs/msg/Odometry, 2 messages) in TRIP cannot give commands, asked for with --commands-topic: that \
         takes messages of type geometry_msgs/msg/Twist or geometry_msgs/msg/TwistStamped",
    );
}

#[test]
fn several_publishers_on_one_topic_are_one_topic() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    let mut bag = Bag::create(&path);
    let first = bag.topic("/scan", LASER_SCAN);
    let second = bag.topic_of_another_publisher("/scan", LASER_SCAN);
    assert_ne!(first, second);
    bag.message(first, 1, &scan((1000, 1), &[1.0]));
    bag.message(second, 2, &scan((1000, 2), &[2.0]));
    bag.finish();
    assert_eq!(read_with(&path, &Selection::default()).unwrap().counts(), [[1000], [2000]]);
}

#[test]
fn a_unit_is_a_positive_number() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    bag_with(&path, true, &[("/scan", LASER_SCAN, "cdr", 1)]);
    for (metres_per_count, shown) in
        [(0.0, "0"), (-0.001, "-0.001"), (f64::NAN, "NaN"), (f64::INFINITY, "inf")]
    {
        assert_eq!(
            refusal(&path, &Selection { metres_per_count, ..Selection::default() }),
            format!("a unit of {shown} metres per count was asked for; it must be a finite number above 0")
        );
    }
}
