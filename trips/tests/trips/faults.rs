//! Files and messages that cannot be read, each with the sentence that says so.

use kinds_trips::Selection;

use crate::bag::{
    Bag, COMPRESSED_IMAGE, Cdr, FLOAT32_MULTI_ARRAY, Folder, IMAGE, LASER_SCAN, ODOMETRY, POINT_CLOUD2,
    RawImage, TWIST, TWIST_STAMPED, image_in, odometry, odometry_in, read, read_whole, refusal, scan,
    scan_in, twist_in, twist_stamped_in,
};

#[test]
fn files_that_are_no_trip_are_refused_in_a_sentence() {
    let folder = Folder::new();
    let check = |name: &str, content: Option<&[u8]>, expected: &str| {
        let path = folder.join(name);
        if let Some(content) = content {
            std::fs::write(&path, content).unwrap();
        }
        let sentence = refusal(&path, &Selection::default());
        assert_eq!(sentence, expected.replace("TRIP", &path.display().to_string()));
    };
    check("missing.mcap", None, "no trip at TRIP: there is no such file");
    check("", None, "TRIP is a directory; a trip is one .mcap file, name the one in it");
    check("empty.mcap", Some(b""), "TRIP is empty (0 bytes): nothing was recorded");
    let not_mcap = "TRIP is neither an MCAP file nor a ROS 1 bag but WHAT; `ros2 bag convert` or `rosbags-convert` makes one of other bags";
    check("text", Some(b"hello"), &not_mcap.replace("WHAT", "of some other kind"));
    check("ros1", Some(b"#ROSBAG V1.2\n"), &not_mcap.replace("WHAT", "a ROS 1 bag of another version"));
    check("ros1.bag", Some(b"#ROSBAG V2.0\n"), "TRIP is cut off at byte 13 of 13, before its first frame");
    check(
        "sqlite",
        Some(b"SQLite format 3\0"),
        &not_mcap.replace("WHAT", "an SQLite database, perhaps an older ROS 2 bag"),
    );
    check("magic.mcap", Some(&mcap::MAGIC[..5]), "TRIP is cut off at byte 5 of 5, before its first frame");
}

#[cfg(unix)]
#[test]
fn what_is_no_regular_file_is_refused_with_the_reason() {
    use std::os::unix::net::UnixListener;
    let folder = Folder::new();
    let path = folder.join("socket");
    let _listener = UnixListener::bind(&path).unwrap();
    assert_eq!(
        refusal(&path, &Selection::default()),
        format!("could not read {}: it is not a regular file", path.display())
    );
}

/// The sentence about the last of these messages, all before it having been read.
fn fault(type_name: &str, messages: &[Vec<u8>]) -> String {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    let mut bag = Bag::create(&path);
    let id = bag.topic("/topic", type_name);
    for (log_time, message) in (0..).zip(messages) {
        bag.message(id, log_time, message);
    }
    // Frames come after what only goes with them.
    let is_beside_frames = [ODOMETRY, TWIST, TWIST_STAMPED].contains(&type_name);
    if is_beside_frames {
        let frames = bag.topic("/scan", LASER_SCAN);
        bag.message(frames, 0, &scan((1000, 0), &[1.0]));
    }
    bag.finish();
    let error = match read(&path) {
        Ok(trip) => {
            let n_read = if is_beside_frames { 0 } else { messages.len() - 1 };
            assert_eq!(trip.frames.len(), n_read, "the frames before the fault are read");
            trip.failure.expect("the last message is faulty")
        }
        Err(error) => error,
    };
    error.to_string().replace(&path.display().to_string(), "TRIP")
}

fn depth(image: RawImage<'_>) -> Vec<u8> {
    image_in(false, (1000, 0), image)
}

const GOOD: RawImage<'static> =
    RawImage { rows: 2, columns: 3, encoding: b"16UC1\0", is_bigendian: 0, step: 6, data: &[7; 12] };

#[test]
fn messages_that_cannot_be_used_are_named_with_what_is_wrong() {
    let whole = scan((1000, 0), &[1.0, 2.0]);
    let check = |type_name: &str, messages: &[Vec<u8>], expected: &str| {
        assert_eq!(fault(type_name, messages), expected);
    };

    let short = whole[..40].to_vec();
    check(
        LASER_SCAN,
        &[whole.clone(), whole.clone(), short],
        "message 3 on /topic in TRIP: its 40 bytes end before its last field does",
    );
    check(
        LASER_SCAN,
        &[vec![0, 1, 0]],
        "message 1 on /topic in TRIP: its 3 bytes end before its last field does",
    );
    check(
        ODOMETRY,
        &[vec![0, 1, 0, 0, 0]],
        "message 1 on /topic in TRIP: its 5 bytes end before its last field does",
    );
    check(
        TWIST,
        &[twist_in(false, 0.0, 0.0), twist_in(false, 0.0, 0.0)[..51].to_vec()],
        "message 2 on /topic in TRIP: its 51 bytes end before its last field does",
    );
    check(
        TWIST_STAMPED,
        &[twist_in(false, 0.0, 0.0)],
        "message 1 on /topic in TRIP: its 52 bytes end before its last field does",
    );
    // Four thousand million ranges are claimed, and none is there.
    let claim = Cdr::new(false).header((1000, 0)).f32s(&[0.0; 7]).u32(u32::MAX).done();
    check(LASER_SCAN, &[claim], "message 1 on /topic in TRIP: its 56 bytes end before its last field does");

    let mut parameter_list = whole.clone();
    parameter_list[1] = 3;
    check(
        LASER_SCAN,
        &[parameter_list],
        "message 1 on /topic in TRIP: its encoding is 0x0003; plain CDR is read, 0x0000 (big-endian) and 0x0001 \
         (little-endian)",
    );
    check(LASER_SCAN, &[scan((1000, 0), &[])], "message 1 on /topic in TRIP: it has no readings (1 × 0)");
    check(
        IMAGE,
        &[depth(RawImage { rows: 0, data: &[], ..GOOD })],
        "message 1 on /topic in TRIP: it has no readings (0 × 3)",
    );
    check(
        IMAGE,
        &[depth(RawImage { encoding: b"rgb8\0", ..GOOD })],
        "message 1 on /topic in TRIP: its image encoding is 'rgb8'; distances are read from 16UC1 and 32FC1",
    );
    check(
        IMAGE,
        &[depth(GOOD), depth(RawImage { step: 5, ..GOOD })],
        "message 2 on /topic in TRIP: its rows are 5 bytes apart, but 3 pixels of 2 bytes need 6",
    );
    check(
        IMAGE,
        &[depth(GOOD), depth(RawImage { step: 8, ..GOOD })],
        "message 2 on /topic in TRIP: it has 12 bytes of pixels, but 2 rows of 8 bytes need 16",
    );
    check(
        IMAGE,
        &[depth(RawImage { rows: u32::MAX, step: u32::MAX, ..GOOD })],
        "message 1 on /topic in TRIP: it has 12 bytes of pixels, but 4294967295 rows of 4294967295 bytes need \
         18446744065119617025",
    );
    check(
        IMAGE,
        &[depth(GOOD), depth(GOOD), depth(RawImage { rows: 3, columns: 2, step: 4, ..GOOD })],
        "frame 3 on /topic in TRIP has 6 readings (3 × 2), but the trip began with 6 readings (2 × 3); a trip has frames \
         of one size",
    );
}

#[test]
fn both_byte_orders_of_cdr_are_read() {
    let folder = Folder::new();
    for big_endian in [false, true] {
        let path = folder.join("trip.mcap");
        let mut bag = Bag::create(&path);
        let (frames, poses) = (bag.topic("/scan", LASER_SCAN), bag.topic("/odom", ODOMETRY));
        let quarter_turn = [0.0, 0.0, 0.5f64.sqrt(), 0.5f64.sqrt()];
        bag.message(poses, 0, &odometry_in(big_endian, (1000, 5), [1.5, -2.5, 0.0], quarter_turn));
        bag.message(frames, 0, &scan_in(big_endian, (1000, 5), &[f32::NAN, 1.25, 0.05, 4.5, f32::INFINITY]));
        bag.finish();
        let trip = read_whole(&path);
        assert_eq!(trip.counts(), [[0, 1250, 0, 0, 4000]]);
        let pose = trip.frames[0].0.pose.unwrap();
        assert_eq!((pose.x_m, pose.y_m), (1.5, -2.5));
        assert!((pose.yaw_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-14);
    }
    for big_endian in [false, true] {
        for (type_name, told) in [
            (TWIST, twist_in(big_endian, 0.25, -1.5)),
            (TWIST_STAMPED, twist_stamped_in(big_endian, (1000, 5), 0.25, -1.5)),
        ] {
            let path = folder.join("commands.mcap");
            let mut bag = Bag::create(&path);
            let (frames, commands) = (bag.topic("/scan", LASER_SCAN), bag.topic("/cmd_vel", type_name));
            bag.message(commands, 1, &told);
            bag.message(frames, 2, &scan((1000, 5), &[1.0]));
            bag.finish();
            assert_eq!(read_whole(&path).commands(), [Some((0.25, -1.5))]);
        }
    }
    for big_endian in [false, true] {
        let path = folder.join("image.mcap");
        let mut bag = Bag::create(&path);
        let frames = bag.topic("/depth", IMAGE);
        // The order of an image's pixels is its own, whatever that of the message.
        for (log_time, is_bigendian, data) in [(1, 0, [1, 2, 3, 4, 9, 9]), (2, 1, [2, 1, 4, 3, 9, 9])] {
            let image =
                RawImage { rows: 1, columns: 2, encoding: b"16UC1\0", is_bigendian, step: 6, data: &data };
            bag.message(frames, log_time, &image_in(big_endian, (0, 0), image));
        }
        bag.finish();
        assert_eq!(read_whole(&path).counts(), [[0x0201, 0x0403]; 2]);
    }
}

#[test]
fn pixels_in_metres_become_counts() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    let mut bag = Bag::create(&path);
    let frames = bag.topic("/depth", IMAGE);
    let metres = [f32::NAN, f32::NEG_INFINITY, -1.0, 0.5, 65.535, 70.0, f32::INFINITY];
    let data: Vec<u8> = metres.iter().flat_map(|metres| metres.to_le_bytes()).collect();
    // Some writers leave out a string's closing zero.
    let image = RawImage { rows: 1, columns: 7, encoding: b"32FC1", is_bigendian: 0, step: 28, data: &data };
    bag.message(frames, 1, &image_in(false, (1000, 0), image));
    bag.finish();
    assert_eq!(read_whole(&path).counts(), [[0, 0, 0, 500, 65535, 0, 65535]]);
}

#[test]
fn messages_of_other_topics_do_not_matter() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    let mut bag = Bag::create(&path);
    let (other, frames) = (bag.topic("/rosout", "rcl_interfaces/msg/Log"), bag.topic("/scan", LASER_SCAN));
    bag.message(other, 0, b"");
    bag.message(frames, 1, &scan((1000, 0), &[1.0]));
    bag.message(other, 2, &odometry((1000, 0), 1.0));
    bag.finish();
    let trip = read_whole(&path);
    assert_eq!((trip.counts(), trip.x_m()), (vec![vec![1000]], vec![None]));
}

/// A cloud as it stands in its message: x, y and z of so many bytes each.
#[derive(Clone, Copy)]
struct Cloud<'a> {
    rows: u32,
    columns: u32,
    fields: &'a [(&'a [u8], u32, u8)],
    point_step: u32,
    row_step: u32,
    data: &'a [u8],
}

const XYZ: [(&[u8], u32, u8); 3] = [(b"x\0", 0, 7), (b"y\0", 4, 7), (b"z\0", 8, 7)];

const GOOD_CLOUD: Cloud<'static> =
    Cloud { rows: 2, columns: 2, fields: &XYZ, point_step: 12, row_step: 24, data: &[0; 48] };

fn cloud(cloud: Cloud<'_>) -> Vec<u8> {
    let mut message = Cdr::new(false).header((1000, 0)).u32(cloud.rows).u32(cloud.columns);
    message = message.u32(cloud.fields.len() as u32);
    for (name, offset, datatype) in cloud.fields {
        message = message.bytes(name).u32(*offset).u8(*datatype).u32(1);
    }
    message.u8(0).u32(cloud.point_step).u32(cloud.row_step).bytes(cloud.data).u8(1).done()
}

#[test]
fn clouds_that_are_no_frames_are_named_with_what_is_wrong() {
    let check = |of: Cloud<'_>, expected: &str| {
        let sentence = fault(POINT_CLOUD2, &[cloud(GOOD_CLOUD), cloud(of)]);
        assert_eq!(sentence, format!("message 2 on /topic in TRIP: {expected}"));
    };
    check(
        Cloud { rows: 1, columns: 4, row_step: 48, ..GOOD_CLOUD },
        "its 4 points are in one row, not organised in rows and columns; a frame has every reading in its place",
    );
    check(Cloud { columns: 0, ..GOOD_CLOUD }, "it has no readings (2 × 0)");
    check(
        Cloud { fields: &[(b"x\0", 0, 7), (b"rgb\0", 4, 7), (b"z\0", 8, 4)], ..GOOD_CLOUD },
        "its points have no x, y and z of FLOAT32 or FLOAT64; they have x, rgb, z",
    );
    check(
        Cloud { fields: &[], ..GOOD_CLOUD },
        "its points have no x, y and z of FLOAT32 or FLOAT64; they have no fields",
    );
    check(Cloud { point_step: 11, ..GOOD_CLOUD }, "its points are 11 bytes apart, but x, y and z need 12");
    check(
        Cloud { fields: &[(b"x\0", 0, 8), (b"y\0", 8, 8), (b"z\0", u32::MAX, 8)], ..GOOD_CLOUD },
        "its points are 12 bytes apart, but x, y and z need 4294967303",
    );
    check(
        Cloud { row_step: 23, ..GOOD_CLOUD },
        "its rows are 23 bytes apart, but 2 pixels of 12 bytes need 24",
    );
    check(
        Cloud { rows: u32::MAX, ..GOOD_CLOUD },
        "it has 48 bytes of pixels, but 4294967295 rows of 24 bytes need 103079215080",
    );
}

/// Numbers with these dimensions: sizes and strides.
fn numbers(dimensions: &[(u32, u32)], offset: u32, data: &[f32]) -> Vec<u8> {
    let mut message = Cdr::new(false).u32(dimensions.len() as u32);
    for (size, stride) in dimensions {
        message = message.bytes(b"\0").u32(*size).u32(*stride);
    }
    message.u32(offset).u32(data.len() as u32).f32s(data).done()
}

#[test]
fn numbers_are_read_by_their_layout_or_named_with_what_is_wrong() {
    let folder = Folder::new();
    let counts = |message: &[u8]| {
        let path = folder.join("trip.mcap");
        let mut bag = Bag::create(&path);
        let id = bag.topic("/topic", FLOAT32_MULTI_ARRAY);
        bag.message(id, 1, message);
        bag.finish();
        let trip = read_whole(&path);
        (trip.layout.rows, trip.layout.columns, trip.counts().concat())
    };
    let six = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    assert_eq!(counts(&numbers(&[], 4, &six)), (1, 2, vec![5000, 6000]));
    assert_eq!(counts(&numbers(&[(0, 0)], 0, &six)), (1, 6, vec![1000, 2000, 3000, 4000, 5000, 6000]));
    assert_eq!(counts(&numbers(&[(2, 2)], 1, &six)), (1, 2, vec![2000, 3000]));
    // Rows that are further apart than they are long.
    assert_eq!(counts(&numbers(&[(2, 6), (2, 3)], 0, &six)), (2, 2, vec![1000, 2000, 4000, 5000]));
    assert_eq!(counts(&numbers(&[(2, 6), (2, 3)], 1, &six)), (2, 2, vec![2000, 3000, 5000, 6000]));
    let check = |message: Vec<u8>, expected: &str| {
        assert_eq!(
            fault(FLOAT32_MULTI_ARRAY, &[message]),
            format!("message 1 on /topic in TRIP: {expected}")
        );
    };
    check(numbers(&[(1, 1); 3], 0, &six), "its numbers have 3 dimensions; a frame has rows and columns");
    check(
        numbers(&[(2, 8), (4, 4)], 0, &six),
        "it has 6 numbers, but 2 rows of 4 need 8 with what lies before and between them",
    );
    check(
        numbers(&[(u32::MAX, 0), (u32::MAX, u32::MAX)], u32::MAX, &six),
        "it has 6 numbers, but 4294967295 rows of 4294967295 need 18446744069414584320 with what lies before and between them",
    );
    check(numbers(&[], 7, &six), "it has no readings (1 × 0)");
    check(numbers(&[], 0, &[]), "it has no readings (1 × 0)");
}

#[test]
fn compressed_images_that_are_no_frames_are_named_with_what_is_wrong() {
    let message =
        |format: &[u8], data: &[u8]| Cdr::new(false).header((1000, 0)).bytes(format).bytes(data).done();
    let check = |format: &[u8], data: &[u8], expected: &str| {
        // Frames are taken from such a topic without being told only where its name says what it has.
        let folder = Folder::new();
        let path = folder.join("trip.mcap");
        let mut bag = Bag::create(&path);
        let id = bag.topic("/topic", COMPRESSED_IMAGE);
        bag.message(id, 0, &message(format, data));
        bag.finish();
        let named = Selection { frames_topic: Some("/topic".to_owned()), ..Selection::default() };
        let sentence = refusal(&path, &named);
        let expected = format!("message 1 on /topic in {}: {expected}", path.display());
        assert!(sentence.starts_with(&expected), "{sentence}");
    };
    let other = "distances are read from 16UC1 and 32FC1 as compressedDepth in PNG or RVL";
    check(b"jpeg\0", &[0; 40], &format!("its format is 'jpeg'; {other}"));
    for format in ["16UC1; compressedDepth zstd", "16UC1; png"] {
        check(format.as_bytes(), &[0; 40], &format!("its format is '{format}'; {other}"));
    }
    check(b"8UC1; compressedDepth\0", &[0; 40], &format!("its format is '8UC1; compressedDepth'; {other}"));
    check(b"16UC1; compressedDepth\0", &[0; 11], "its ");
    check(b"16UC1; compressedDepth\0", &[0; 40], "its PNG cannot be read: ");
    // What claims 2³¹ × 2³¹ pixels is refused before any is held.
    let mut claims = vec![0; 12];
    claims.extend(b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\x7f\xff\xff\xff\x7f\xff\xff\xff\x10\0\0\0\0");
    claims.extend([0; 20]);
    check(b"16UC1; compressedDepth\0", &claims, "its PNG cannot be read: ");
    let rvl = |columns: u32, rows: u32, words: &[u8]| {
        [&[0; 12], &columns.to_le_bytes()[..], &rows.to_le_bytes(), words].concat()
    };
    let check_rvl = |data: &[u8], expected: &str| check(b"16UC1; compressedDepth rvl\0", data, expected);
    check_rvl(&[0; 19], "its 79 bytes end before its last field does");
    check_rvl(&rvl(3, 2, &[]), "its RVL cannot be read: it ends before its last pixel");
    check_rvl(&rvl(3, 2, &[0, 0, 0, 0x70]), "its RVL cannot be read: it has more pixels than it says");
    check_rvl(&rvl(3, 2, &[0xff; 8]), "its RVL cannot be read: a number in it has more than 32 bits");
    check_rvl(&rvl(0, 2, &[0; 8]), "it has no readings (2 × 0)");
    check_rvl(
        &rvl(u32::MAX, u32::MAX, &[0; 8]),
        "it has 4294967295 × 4294967295 readings; a frame has at most 16777216",
    );
}
