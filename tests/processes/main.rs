//! Several processes of the built program, as on the robot: every test starts `kinds` and meets it in shared memory.
//!
//! Each test has a robot of its own: a folder to work in and a domain that no other test knows. Nothing here asserts
//! how fast something is, and every wait ends at a deadline.

mod asked_wrongly;
mod bad_trips;
#[cfg(feature = "bridge")]
mod bridge;
mod check;
mod commands;
mod consumer;
mod consumers;
mod demo;
mod devices;
mod doctor;
mod evaluate;
mod faults;
mod health;
mod join;
mod killed;
mod living;
mod log;
mod models;
mod narrow;
#[cfg(feature = "bridge")]
mod network;
mod notify;
mod novelty;
mod ordeal;
mod publish;
mod real_trips;
mod realtime;
mod record;
mod reload;
mod replay;
mod robot;
mod running;
mod serve;
mod simulated;
#[path = "../soak/mod.rs"]
mod soak;
mod train;
mod train_report;
mod trips;
mod tutorial;
mod watch;
mod way;
mod witness;
mod world;
