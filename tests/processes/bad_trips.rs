//! Trips that are not as they should be: each is a sentence and an exit code, and leaves nothing half-written.

use serde_json::Value;

use crate::robot::{FIRST, MODEL, Robot, SECOND, SENSOR, SIZE};
use crate::world::Trip;

/// What is said of [`Trip::SECOND`] with half the readings from its 51st frame on.
pub(crate) const CHANGING: &str = "frame 51 on /ring in changing.mcap has 8 readings (1 × 8), but the trip began with \
                                   16 readings (1 × 16); a trip has frames of one size";

/// Writes a trip that a power cut ended, and returns how many whole frames it has.
pub(crate) fn write_cut_off(robot: &Robot, name: &str) -> usize {
    let path = robot.path(name);
    Trip { in_small_chunks: true, ..Trip::SECOND }.write(&path);
    let whole = std::fs::read(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() * 3 / 5]).unwrap();
    let n_frames = crate::world::read_trip(&path).len();
    assert!((40..100).contains(&n_frames), "{n_frames} frames are left");
    n_frames
}

/// What is said of a trip that was cut off.
pub(crate) fn cut_off(robot: &Robot, name: &str) -> String {
    let mut trip = kinds_trips::TripReader::open(&robot.path(name), &Default::default()).unwrap();
    let mut counts = vec![0; trip.layout().n_readings()];
    while trip.next_frame(&mut counts).unwrap().is_some() {}
    let truncation = trip.truncation().unwrap();
    let kinds_trips::Truncation { at_byte, n_bytes, n_frames, .. } = truncation;
    format!(
        "trip {name} is cut off at byte {at_byte} of {n_bytes}; the {n_frames} frames before that were read"
    )
}

/// A robot with a model, and a trip by the name of `bad.mcap` that cannot be read.
fn check(bad: impl AsRef<[u8]>, sentence: &str) {
    let robot = Robot::trained();
    robot.write("bad.mcap", bad);
    check_every_verb(&robot, "bad.mcap", sentence);
}

/// Whatever reads a trip says the same of it, before it does anything else.
fn check_every_verb(robot: &Robot, trip: &str, sentence: &str) {
    robot.refuse(&["train", trip, "--output", "new.kinds"], 1, sentence);
    robot.refuse(&["train", FIRST, trip, "--output", MODEL], 1, sentence);
    robot.refuse(&["evaluate", MODEL, FIRST, trip], 1, sentence);
    robot.refuse(&["evaluate", MODEL, trip, SECOND, "--json"], 1, sentence);
    robot.refuse(&["publish", "--trip", trip, "--sensor", SENSOR], 1, sentence);
    assert_eq!(robot.shared_memory(), [""; 0]);
}

#[test]
fn a_trip_that_is_not_there_is_a_sentence() {
    check_every_verb(&Robot::trained(), "nowhere.mcap", "no trip at nowhere.mcap: there is no such file");
    check_every_verb(
        &Robot::trained(),
        ".",
        ". is a directory; a trip is one .mcap file, name the one in it",
    );
}

#[test]
fn a_file_that_is_no_trip_is_a_sentence() {
    check("", "bad.mcap is empty (0 bytes): nothing was recorded");
    check(
        "frame,range\n0,1.25\n",
        "bad.mcap is neither an MCAP file nor a ROS 1 bag but of some other kind; `ros2 bag convert` or `rosbags-convert` \
         makes one of other bags",
    );
}

#[test]
fn a_trip_without_frames_is_a_sentence_that_lists_its_topics() {
    let robot = Robot::trained();
    Trip { frames_topics: &[], ..Trip::FIRST }.write(&robot.path("odometry.mcap"));
    check_every_verb(
        &robot,
        "odometry.mcap",
        "odometry.mcap has no frames: none of its topics has messages of type sensor_msgs/msg/LaserScan, \
         sensor_msgs/msg/Image, sensor_msgs/msg/PointCloud2, sensor_msgs/msg/CompressedImage (compressedDepth), sensor_msgs/msg/Range or \
         std_msgs/msg/Float32MultiArray; it has /odom (nav_msgs/msg/Odometry, 160 messages)",
    );
}

#[test]
fn a_trip_cut_off_before_its_first_frame_is_a_sentence() {
    let robot = Robot::trained();
    let whole = robot.read(FIRST);
    robot.write("cut.mcap", &whole[..600]);
    // Magic bytes and the header are whole: opcode, length of the rest, and the rest.
    let length: [u8; 8] = whole[9..17].try_into().unwrap();
    let at_byte = 17 + u64::from_le_bytes(length);
    let sentence = format!("cut.mcap is cut off at byte {at_byte} of 600, before its first frame");
    check_every_verb(&robot, "cut.mcap", &sentence);
}

#[test]
fn a_trip_that_was_cut_off_is_used_up_to_there_and_that_is_said() {
    let robot = Robot::trained();
    let n_frames = write_cut_off(&robot, "cut.mcap");
    let said = format!("kinds: {}\n", cut_off(&robot, "cut.mcap"));
    let trained = robot.run(&[&["train", "cut.mcap", "--output", "cut.kinds"][..], &SIZE].concat());
    assert_eq!((trained.code, &trained.stderr), (Some(0), &said));
    let inspection: Value =
        serde_json::from_str(&robot.succeed(&["inspect", "cut.kinds", "--json"])).unwrap();
    assert_eq!(inspection["n_frames"], n_frames);
    let evaluated = robot.run(&["evaluate", MODEL, FIRST, "cut.mcap"]);
    assert_eq!((evaluated.code, &evaluated.stderr), (Some(0), &said));
}

#[test]
fn a_trip_without_poses_is_trained_on_and_evaluation_says_why_it_cannot() {
    let robot = Robot::trained();
    Trip { poses_topics: &[], ..Trip::SECOND }.write(&robot.path("lost.mcap"));
    robot.succeed(&["train", "lost.mcap", "--output", "lost.kinds"]);
    let sentence = "trip lost.mcap has no poses: consistency compares the kinds of one place, so evaluation needs \
                    nav_msgs/msg/Odometry or geometry_msgs/msg/PoseStamped in both trips (training does not)";
    robot.refuse(&["evaluate", MODEL, FIRST, "lost.mcap"], 1, sentence);
    robot.refuse(&["evaluate", "lost.kinds", "lost.mcap", FIRST], 1, sentence);
}

#[test]
fn trips_that_never_meet_are_a_sentence() {
    let robot = Robot::trained();
    Trip { x_m: 100.0, ..Trip::SECOND }.write(&robot.path("elsewhere.mcap"));
    robot.refuse(
        &["evaluate", MODEL, FIRST, "elsewhere.mcap", "--radius-m", "0.25"],
        1,
        "first.mcap and elsewhere.mcap lie in boxes that do not overlap, within 0.25 m: x -3.0…3.0 and 97.0…103.0 m, y -3.0…3.0 and \
         -3.0…3.0 m; either the trips are of different spaces (give those of another space to --elsewhere), or their poses have \
         different origins and must be registered first",
    );
    // As long as any two meet, the others are only told.
    let told = robot.run(&["evaluate", MODEL, FIRST, "elsewhere.mcap", SECOND]);
    assert_eq!((told.code, told.stderr.lines().count()), (Some(0), 2), "{}", told.stderr);
    assert!(told.stdout.starts_with("first revisited by second\n"), "{}", told.stdout);
    Trip { x_m: 5.9, ..Trip::SECOND }.write(&robot.path("beside.mcap"));
    robot.refuse_with(
        &["evaluate", MODEL, FIRST, "beside.mcap", "--radius-m", "0.001"],
        1,
        &["no frame of first.mcap has a frame of beside.mcap within 0.001 m: the trips come no nearer to each other than 0.", " m; try a larger radius"],
    );
}

#[test]
fn topics_to_choose_from_are_listed_with_the_flag_that_chooses() {
    let robot = Robot::trained();
    Trip { frames_topics: &["/front", "/rear"], ..Trip::FIRST }.write(&robot.path("two.mcap"));
    check_every_verb(
        &robot,
        "two.mcap",
        "two.mcap has 2 topics with frames: /front (sensor_msgs/msg/LaserScan, 160 messages), /rear \
         (sensor_msgs/msg/LaserScan, 160 messages); choose one with --frames-topic NAME, or join several with \
         --frames-topic NAME,NAME",
    );
    robot.succeed(&["train", "two.mcap", "--output", "rear.kinds", "--frames-topic", "/rear"]);
    robot.write("topic.ron", "(frames_topic: \"/rear\")");
    robot.succeed(&["train", "two.mcap", "--output", "again.kinds", "--config", "topic.ron"]);
    assert!(robot.read("again.kinds") == robot.read("rear.kinds"));
    robot.refuse(
        &["train", "two.mcap", "--output", "new.kinds", "--frames-topic", "/left"],
        1,
        "two.mcap has no topic /left, asked for with --frames-topic; it has /front (sensor_msgs/msg/LaserScan, 160 \
         messages), /odom (nav_msgs/msg/Odometry, 160 messages), /rear (sensor_msgs/msg/LaserScan, 160 messages)",
    );
    robot.refuse(
        &["train", "two.mcap", "--output", "new.kinds", "--frames-topic", "/odom"],
        1,
        "/odom (nav_msgs/msg/Odometry, 160 messages) in two.mcap cannot give frames, asked for with --frames-topic: \
         that takes messages of type sensor_msgs/msg/LaserScan, sensor_msgs/msg/Image, sensor_msgs/msg/PointCloud2, \
         sensor_msgs/msg/CompressedImage (compressedDepth), sensor_msgs/msg/Range or std_msgs/msg/Float32MultiArray",
    );

    Trip { poses_topics: &["/odom", "/slam"], ..Trip::FIRST }.write(&robot.path("poses.mcap"));
    robot.refuse(
        &["evaluate", MODEL, "poses.mcap", "poses.mcap"],
        1,
        "poses.mcap has 2 topics with poses: /odom (nav_msgs/msg/Odometry, 160 messages), /slam \
         (nav_msgs/msg/Odometry, 160 messages); choose one with --poses-topic NAME",
    );
    robot.succeed(&["evaluate", MODEL, "poses.mcap", "poses.mcap", "--poses-topic", "/slam"]);
}

#[test]
fn a_frame_size_that_changes_within_a_trip_is_a_sentence() {
    let robot = Robot::trained();
    Trip { halved_from: 50, ..Trip::SECOND }.write(&robot.path("changing.mcap"));
    robot.refuse(&["train", "changing.mcap", "--output", "new.kinds"], 1, CHANGING);
    robot.refuse(&["evaluate", MODEL, FIRST, "changing.mcap"], 1, CHANGING);
}

#[test]
fn too_few_frames_are_a_sentence() {
    let robot = Robot::trained();
    Trip { n_frames: 8, ..Trip::FIRST }.write(&robot.path("short.mcap"));
    let train = ["train", "short.mcap", "--output", MODEL];
    robot.refuse_with(
        &[&train[..], &["--neighbors", "10"]].concat(),
        1,
        &["8 frames are too few for 10 neighbours each; ask for fewer neighbours or record a longer trip"],
    );
    robot.refuse_with(
        &[&train[..], &["--neighbors", "5", "--kinds", "9"]].concat(),
        1,
        &["8 frames cannot make 9 kinds; ask for fewer kinds or record a longer trip"],
    );
}

#[test]
fn frames_that_tell_nothing_are_a_sentence() {
    let robot = Robot::trained();
    Trip { is_constant: true, ..Trip::FIRST }.write(&robot.path("constant.mcap"));
    robot.refuse_with(
        &["train", "constant.mcap", "--output", MODEL],
        1,
        &["all 160 frames are equal on the response's scale; there is nothing to tell kinds by"],
    );
    let all: Vec<usize> = (0..160).collect();
    Trip { invalid_frames: &all, ..Trip::FIRST }.write(&robot.path("blind.mcap"));
    let sentence = "trip blind.mcap: none of its 160 frames has a valid reading";
    robot.refuse(&["train", "blind.mcap", "--output", MODEL], 1, sentence);
    robot.refuse(&["evaluate", MODEL, FIRST, "blind.mcap"], 1, sentence);
}

#[test]
fn frames_without_any_valid_reading_are_left_out_and_that_is_said() {
    let robot = Robot::trained();
    Trip { invalid_frames: &[3, 40, 41], ..Trip::FIRST }.write(&robot.path("some.mcap"));
    let outcome = robot.run(&[&["train", "some.mcap", "--output", "some.kinds"][..], &SIZE].concat());
    assert_eq!(outcome.code, Some(0));
    assert_eq!(outcome.stderr, "kinds: 3 frames without any valid reading were left out\n");
    assert!(outcome.stdout.starts_with("learnt 5 kinds from 157 frames of 16 readings"), "{outcome:?}");
    let text = robot.succeed(&["inspect", "some.kinds"]);
    assert!(text.contains("157 reference frames; 3 without any valid reading left out"), "{text}");
}

#[test]
fn trips_of_another_sensor_are_a_sentence() {
    let robot = Robot::trained();
    Trip { n_readings: 8, ..Trip::FIRST }.write(&robot.path("eight.mcap"));
    robot.refuse(
        &["train", FIRST, "eight.mcap", "--output", MODEL],
        1,
        "trip eight.mcap has frames of 8 readings (1 × 8) of 0.001 m a count; those of the trips before it are of 16 \
         readings (1 × 16) of 0.001 m a count; train one model for each sensor",
    );
    robot.refuse(
        &["evaluate", MODEL, FIRST, "eight.mcap"],
        1,
        "trip eight.mcap has frames of 8 readings (1 × 8) of 0.001 m a count; the model understands frames of 16 \
         readings (1 × 16) of 0.001 m a count",
    );
}
