//! What sends frames as bytes, as a device.

use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use kinds_messages::ns_since_epoch;
use kinds_trips::{FrameLayout, Stamp};

use super::address::Address;
use super::assembly::Assembly;
use super::decoder::{Decoder, Found};
use super::link::{Link, Pipe, Received};
use super::part::Part;
use super::serial::Serial;
use super::troubles::{LeftOut, Trouble, Troubles};
use crate::layout::{self, LayoutError};
use crate::{NumberedFrame, Reading, Sensor, SensorError};

/// A device that sends its frames as the [module](super) says. Whatever else comes is left out, counted and said.
pub struct Wired {
    address: Address,
    link: Box<dyn Link>,
    layout: FrameLayout,
    decoder: Decoder,
    assembly: Assembly,
    troubles: Troubles,
}

/// Why frames cannot be read as bytes.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WireError {
    /// What no device has.
    #[error(transparent)]
    Layout(#[from] LayoutError),
    /// Nothing comes from it.
    #[error("cannot read {address}: {error}")]
    Link {
        /// Where it is.
        address: Address,
        /// What the system says.
        error: io::Error,
    },
}

impl Wired {
    /// Opens what sends frames of a layout. A serial line need not be there yet.
    pub fn open(address: Address, layout: FrameLayout) -> Result<Self, WireError> {
        layout::check(layout)?;
        let link: Box<dyn Link> = match &address {
            Address::Udp(socket) => match listen(*socket) {
                Ok(socket) => Box::new(socket),
                Err(error) => return Err(WireError::Link { address, error }),
            },
            Address::Stdin => Box::new(Pipe(io::stdin())),
            Address::Serial { path, baud } => Box::new(Serial::new(path.clone(), *baud)),
        };
        Ok(Self::over(link, address, layout))
    }

    pub(crate) fn over(link: Box<dyn Link>, address: Address, layout: FrameLayout) -> Self {
        Self {
            address,
            link,
            layout,
            decoder: Decoder::new(layout),
            assembly: Assembly::new(layout.n_readings()),
            troubles: Troubles::default(),
        }
    }

    /// What has been left out so far.
    pub fn left_out(&self) -> LeftOut {
        self.troubles.left_out()
    }

    /// The next frame among the bytes that are here.
    fn next_frame(&mut self, counts: &mut [u16]) -> Option<NumberedFrame> {
        while let Some(found) = self.decoder.next() {
            match found {
                Found::Noise(n_bytes) => self.troubles.count(Trouble::Noise, n_bytes),
                Found::Foreign(part) => {
                    let layout = self.layout;
                    self.troubles.count_as(Trouble::Foreign, 1, || foreign(&part, layout));
                }
                Found::Part(part) => {
                    let sent = self.decoder.counts();
                    let now = Stamp(ns_since_epoch());
                    let frame = self.assembly.add(&part, sent, counts, now, &mut self.troubles);
                    if frame.is_some() {
                        self.troubles.frame_came();
                        return frame;
                    }
                }
            }
        }
        None
    }

    /// Nothing that has begun goes on.
    fn break_off(&mut self) {
        let n_bytes = self.decoder.clear();
        if n_bytes > 0 {
            self.troubles.count(Trouble::Noise, n_bytes);
        }
    }
}

impl Sensor for Wired {
    fn layout(&self) -> FrameLayout {
        self.layout
    }

    fn read(&mut self, counts: &mut [u16], timeout: Duration) -> Result<Reading, SensorError> {
        let deadline = Instant::now() + timeout;
        loop {
            if let Some(frame) = self.next_frame(counts) {
                return Ok(Reading::Numbered(frame));
            }
            if self.link.is_of_messages() {
                self.break_off();
            }
            let left = deadline.saturating_duration_since(Instant::now());
            let received = self.link.receive(self.decoder.room(), left);
            match received.map_err(|error| WireError::Link { address: self.address.clone(), error })? {
                Received::Bytes(n_bytes) => self.decoder.came(n_bytes),
                Received::Nothing => return Ok(Reading::NotYet),
                Received::Gone(words) => {
                    self.break_off();
                    self.assembly.start_anew();
                    self.troubles.say(words);
                }
                Received::Back(words) => self.troubles.say(words),
                Received::End => {
                    self.break_off();
                    return Ok(Reading::End);
                }
            }
            // Whoever sends nothing but noise does not keep the caller here.
            if left.is_zero() {
                return Ok(self.next_frame(counts).map_or(Reading::NotYet, Reading::Numbered));
            }
        }
    }

    fn news(&mut self) -> Option<String> {
        self.troubles.news()
    }
}

/// A socket whose reads never wait: a datagram that woke us may be found spoilt, and gone, when it is read.
fn listen(address: SocketAddr) -> Result<UdpSocket, io::Error> {
    let socket = UdpSocket::bind(address)?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

fn foreign(part: &Part, ours: FrameLayout) -> String {
    let Part { rows, columns, nanometres_per_count, .. } = part;
    let FrameLayout { rows: our_rows, columns: our_columns, metres_per_count } = ours;
    let theirs_m = f64::from(*nanometres_per_count) / 1e9;
    format!(
        "frames of {rows} × {columns} readings at {theirs_m} m a count come, not of {our_rows} × {our_columns} at \
         {metres_per_count} m; they are left out"
    )
}
