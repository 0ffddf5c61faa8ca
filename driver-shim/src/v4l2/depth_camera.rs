//! A depth camera as a device, which may be unplugged and come back.

use std::collections::VecDeque;
use std::fmt;
use std::io;
use std::path::Path;
use std::time::{Duration, Instant};

use kinds_messages::Spell;
use kinds_trips::FrameLayout;

use super::address::CameraAddress;
use super::kernel::KernelDevice;
use super::negotiation::CameraError;
use super::numbering::Numbering;
use super::stream::{Picture, State, Stream};
use super::video_device::VideoDevice;
use crate::layout::{self, LayoutError};
use crate::{Capture, NumberedFrame, Reading, Sensor, SensorError};

/// Between two looks whether the device is back.
const RETRY: Duration = Duration::from_millis(500);

type Open = Box<dyn FnMut(&Path) -> io::Result<Box<dyn VideoDevice>>>;

/// A camera of Video4Linux. It is opened when its first frame is wanted, and again whenever it was gone; what is no whole frame is left
/// out, counted and said.
pub struct DepthCamera {
    address: CameraAddress,
    layout: FrameLayout,
    open: Open,
    stream: Option<Stream>,
    has_streamed: bool,
    retry_at: Instant,
    /// Why it cannot be read, as far as it was told.
    told: Option<CameraError>,
    told_remark: bool,
    numbering: Numbering,
    damaged: Spell,
    short: Spell,
    news: VecDeque<String>,
}

/// How many of a camera's frames were left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// Flagged by its driver: what it was sent was damaged.
    pub n_damaged: u64,
    /// With fewer bytes than a frame has.
    pub n_short: u64,
}

impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { n_damaged, n_short } = self;
        write!(f, "{n_damaged} frames that its driver flagged as damaged, {n_short} that were cut short")
    }
}

impl DepthCamera {
    /// A camera that sends frames of a layout. It need not be there yet.
    pub fn new(address: CameraAddress, layout: FrameLayout) -> Result<Self, LayoutError> {
        let open = |path: &Path| Ok(Box::new(KernelDevice::open(path)?) as Box<dyn VideoDevice>);
        Self::opened_by(Box::new(open), address, layout)
    }

    pub(crate) fn opened_by(
        open: Open,
        address: CameraAddress,
        layout: FrameLayout,
    ) -> Result<Self, LayoutError> {
        layout::check(layout)?;
        Ok(Self {
            address,
            layout,
            open,
            stream: None,
            has_streamed: false,
            retry_at: Instant::now(),
            told: None,
            told_remark: false,
            numbering: Numbering::default(),
            damaged: Spell::default(),
            short: Spell::default(),
            news: VecDeque::new(),
        })
    }

    /// What has been left out so far.
    pub fn left_out(&self) -> LeftOut {
        LeftOut { n_damaged: self.damaged.n(), n_short: self.short.n() }
    }

    /// Starts a stream, if it is time to try. An error if no waiting will help.
    fn open_again(&mut self, timeout: Duration) -> Result<(), CameraError> {
        let wait = self.retry_at.saturating_duration_since(Instant::now());
        std::thread::sleep(wait.min(timeout));
        if wait > timeout {
            return Ok(());
        }
        let CameraAddress { path, rate_hz } = &self.address;
        let opened = (self.open)(path).map_err(|error| CameraError::Io { path: path.clone(), error });
        let mut stream = match opened.and_then(|device| Stream::start(device, path, self.layout, *rate_hz)) {
            // Once it has streamed, what is wrong now may be another camera, and the right one come yet.
            Err(error) if error.may_pass() || self.has_streamed => {
                self.wait_for(error);
                return Ok(());
            }
            stream => stream?,
        };
        if self.told.take().is_some() {
            self.news.push_back(format!("{} can be read", path.display()));
        }
        if let Some(remark) = stream.take_remark()
            && !std::mem::replace(&mut self.told_remark, true)
        {
            self.news.push_back(remark);
        }
        self.numbering.start_anew();
        self.has_streamed = true;
        self.stream = Some(stream);
        Ok(())
    }

    /// Leaves a device that cannot be read. It is told once, and once more if the device that comes back is not the right one.
    fn wait_for(&mut self, error: CameraError) {
        self.stream = None;
        self.retry_at = Instant::now() + RETRY;
        if self.told.as_ref().is_some_and(|told| !told.may_pass() || error.may_pass()) {
            return;
        }
        self.news.push_back(match error.may_pass() {
            true => format!("{error}; waiting until it can"),
            false => format!("{error}; waiting for the right one"),
        });
        self.told = Some(error);
    }

    /// The frame of a picture, if its counts are there.
    fn frame(&mut self, picture: &Picture) -> Option<NumberedFrame> {
        // Also of one that is left out, which is lost then.
        let sequence = self.numbering.place(picture.number);
        match picture.state {
            State::Damaged => {
                if self.damaged.count(1) {
                    self.news.push_back(
                        "frames come damaged, as their driver says; they are left out".to_string(),
                    );
                }
                return None;
            }
            State::Short { n_bytes, n_bytes_expected } => {
                if self.short.count(1) {
                    self.news.push_back(format!(
                        "frames come short, of {n_bytes} bytes instead of {n_bytes_expected}; they are left out"
                    ));
                }
                return None;
            }
            State::Whole => {}
        }
        for (spell, what) in [(&mut self.damaged, "damaged"), (&mut self.short, "short")] {
            if let Some(n) = spell.calm() {
                self.news
                    .push_back(format!("frames come as they should again; {n} {what} ones were left out"));
            }
        }
        let capture = Capture::at(picture.captured);
        Some(NumberedFrame { capture, sequence, n_readings: self.layout.n_readings() })
    }
}

impl Sensor for DepthCamera {
    fn layout(&self) -> FrameLayout {
        self.layout
    }

    fn read(&mut self, counts: &mut [u16], timeout: Duration) -> Result<Reading, SensorError> {
        let deadline = Instant::now() + timeout;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            if let Some(stream) = &mut self.stream {
                match stream.next(counts, left) {
                    Ok(None) => return Ok(Reading::NotYet),
                    Ok(Some(picture)) => {
                        if let Some(frame) = self.frame(&picture) {
                            return Ok(Reading::Numbered(frame));
                        }
                    }
                    Err(error) => self.wait_for(CameraError::Io { path: self.address.path.clone(), error }),
                }
            } else {
                self.open_again(left)?;
            }
            // A camera of which no frame is whole does not keep the caller here.
            if left.is_zero() {
                return Ok(Reading::NotYet);
            }
        }
    }

    fn news(&mut self) -> Option<String> {
        self.news.pop_front()
    }
}
