//! A sensor's channels for programs in C, and in whatever can call C: kinds and frames read where they lie, and the way in
//! for drivers.
//!
//! `include/natural_kinds.h` is made of this crate's sources and those of the messages, and is what its users read: comments
//! here speak of C. Names are C's too. Every function
//!
//! - returns −1 or NULL when it could not, with the reason in words for [`kinds_last_error`];
//! - refuses NULL, and a handle that another thread is using at this moment, as such an error;
//! - lets no panic through: that is an error too, and a bug here;
//! - trusts its caller only in what cannot be checked: that pointers which are not NULL are what they are said to be.
//!
//! A handle and all that came from it are for one thread at a time. A thread may hand them to another: nothing in them, or in
//! the transport below, belongs to a thread, and what they share they share among themselves only, since each handle joins the
//! domain as a member of its own. What is lent is given back through its handle for the same reason. After `fork` a child must
//! not touch them.
#![allow(non_camel_case_types, reason = "the names are C's")]
#![allow(unsafe_code, reason = "C hands over pointers")]

mod call;
mod frames;
mod handle;
mod member;
mod publisher;
mod reports;

pub use call::{kinds_last_error, kinds_version};
pub use frames::{
    kinds_frame, kinds_frames, kinds_frames_close, kinds_frames_next, kinds_frames_open, kinds_frames_release,
};
pub use member::{
    KINDS_BY_EVENT, KINDS_ERROR, KINDS_INTERRUPTED, KINDS_NOTHING, KINDS_POLLING, KINDS_RECEIVED,
};
pub use publisher::{
    kinds_loan, kinds_publisher, kinds_publisher_borrow, kinds_publisher_close, kinds_publisher_give_back,
    kinds_publisher_n_readers, kinds_publisher_open, kinds_publisher_send, kinds_publisher_update,
};
pub use reports::{
    kinds_report_at_level, kinds_reports, kinds_reports_close, kinds_reports_is_served, kinds_reports_next,
    kinds_reports_open, kinds_reports_release,
};
