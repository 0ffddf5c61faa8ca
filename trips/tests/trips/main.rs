//! Trips as others find them on disk: written and read back, damaged, cut off, made by other programs.

mod bag;
mod choosing;
mod commands;
mod damage;
mod faults;
mod info;
mod joined;
mod made_by_rosbags;
mod made_elsewhere;
mod poses;
mod ranges;
mod read_elsewhere;
mod round_trip;
mod salvage;
mod salvage_ros1;
