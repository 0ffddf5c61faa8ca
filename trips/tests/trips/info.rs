//! What is said of a recording: topics, rates, gaps, and what each could be read as.

use kinds_trips::{Choice, Gap, Gives, Role, Stamp, TripInfo};

use crate::bag::{
    Bag, COMPRESSED_IMAGE, Cdr, Folder, IMAGE, LASER_SCAN, ODOMETRY, RawImage, TWIST, image_in, odometry,
    read_whole, scan, twist_in,
};

const MS: u32 = 1_000_000;

fn image(stamp: (u32, u32), encoding: &[u8]) -> Vec<u8> {
    let image = RawImage { rows: 1, columns: 2, encoding, is_bigendian: 0, step: 4, data: &[1, 2, 3, 4] };
    image_in(false, stamp, image)
}

#[test]
fn a_topic_has_a_rate_by_its_own_stamps_its_gaps_and_what_it_can_be() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    let mut bag = Bag::create(&path);
    let [frames, colours, poses, told, other, jpeg] = [
        ("/depth", IMAGE),
        ("/rgb", IMAGE),
        ("/odom", ODOMETRY),
        ("/cmd_vel", TWIST),
        ("/rosout", "rcl_interfaces/msg/Log"),
        ("/rgb/compressed", COMPRESSED_IMAGE),
    ]
    .map(|(name, type_name)| bag.topic(name, type_name));
    for index in 0..20u32 {
        // Stamps are 50 ms apart, the recorder wrote them down in no time; six are missing.
        let stamp = (1000, 50 * MS * index);
        if !(7..13).contains(&index) {
            bag.message(frames, 5, &image(stamp, b"16UC1\0"));
        }
        bag.message(colours, 5, &image(stamp, b"rgb8\0"));
        bag.message(poses, 5, &odometry(if index == 3 { (1000, 0) } else { stamp }, 1.0));
        // Without a stamp of its own.
        bag.message(told, u64::from(index) * 10_000_000, &twist_in(false, 1.0, 0.0));
    }
    bag.message(other, 7, b"anything");
    bag.message(jpeg, 7, &Cdr::new(false).header((1000, 0)).bytes(b"jpeg\0").bytes(&[0; 9]).done());
    bag.finish();

    let info = TripInfo::read(&path).unwrap();
    let names: Vec<&str> = info.topics.iter().map(|topic| topic.topic.name.as_str()).collect();
    assert_eq!(names, ["/cmd_vel", "/depth", "/odom", "/rgb", "/rgb/compressed", "/rosout"]);
    let [told, frames, poses, colours, jpeg, other] = &info.topics[..] else { panic!("{info:?}") };
    let rate_hz = |period_s: Option<f64>| period_s.map(|period_s| (1e6 / period_s).round() / 1e6);
    assert_eq!((rate_hz(frames.period_s), frames.topic.n_messages), (Some(20.0), 14));
    let longest = Gap { after: Stamp(1_000_300_000_000), length_s: 0.35 };
    let (n_gaps, gap) = frames.gaps.unwrap();
    assert_eq!((n_gaps, gap.after), (1, longest.after));
    assert!((gap.length_s - longest.length_s).abs() < 1e-9);
    assert_eq!(frames.span, Some((Stamp(1_000_000_000_000), Stamp(1_000_950_000_000))));
    assert_eq!((poses.n_backwards, poses.gives.clone()), (1, Gives::Poses));
    assert_eq!((rate_hz(told.period_s), told.gives.clone()), (Some(100.0), Gives::Commands));
    assert_eq!((other.period_s, other.gives.clone()), (None, Gives::Nothing));
    let Gives::Unfit(Role::Frames, fault) = &colours.gives else { panic!("{colours:?}") };
    assert_eq!(fault.to_string(), "its image encoding is 'rgb8'; distances are read from 16UC1 and 32FC1");
    assert!(matches!(jpeg.gives, Gives::Unfit(Role::Frames, _)));

    // Two topics have images, so that the one with distances must be named.
    let [Choice { name, is_default: false, layout: Some(layout) }] = &info.frames()[..] else {
        panic!("{info:?}")
    };
    assert_eq!((name.as_str(), layout.rows, layout.columns), ("/depth", 1, 2));
    let poses = Choice { name: "/odom".to_owned(), is_default: true, layout: None };
    assert_eq!(info.beside_frames(Role::Poses), [poses]);
}

#[test]
fn messages_of_ros_1_in_mcap_are_read_as_well() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    let mut bag = Bag::create(&path);
    let id = bag.topic_encoded("/scan", "sensor_msgs/LaserScan", "ros1");
    let ns_of_a_second = 500 * MS;
    let mut message = Vec::new();
    for word in [7, 1000, ns_of_a_second, 5] {
        message.extend(word.to_le_bytes());
    }
    message.extend(b"laser");
    for number in [0.0, 1.0, 0.5, 0.0, 0.0, 0.1f32, 4.0] {
        message.extend(number.to_le_bytes());
    }
    message.extend(2u32.to_le_bytes());
    for number in [1.5f32, f32::INFINITY] {
        message.extend(number.to_le_bytes());
    }
    message.extend(0u32.to_le_bytes());
    bag.message(id, 1, &message);
    let cdr = bag.topic_encoded("/json", LASER_SCAN, "json");
    bag.message(cdr, 1, &scan((1000, 0), &[1.0]));
    bag.finish();
    let trip = read_whole(&path);
    assert_eq!(trip.counts(), [[1500, 4000]]);
    assert_eq!(trip.frames[0].0.captured, Stamp(1_000_500_000_000));
    let info = TripInfo::read(&path).unwrap();
    assert_eq!(info.frames().len(), 1, "what is encoded in some other way is not read");
    assert_eq!(info.topics[1].topic.to_string(), "/scan (sensor_msgs/LaserScan, 1 message)");
}
