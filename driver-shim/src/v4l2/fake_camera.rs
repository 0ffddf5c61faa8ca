//! A camera in memory, as a driver of the kernel would show it.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::io;
use std::path::Path;
use std::rc::Rc;
use std::time::Duration;

use rustix::io::Errno;

use super::abi::{
    Buffer, CAN_CAPTURE, CAN_SET_RATE, CAN_STREAM, CAPTURE, CLOCK_MONOTONIC, Capability, Format,
    FormatDescription, FrameSize, MAPPED, ONE_SIZE, RequestBuffers, SAYS_OF_DEVICE, StreamParameters,
};
use super::video_device::VideoDevice;

/// What happens next to a camera that streams.
#[derive(Clone, Debug)]
pub(super) enum Event {
    /// A frame comes.
    Frame(Sent),
    /// None does for as long as is waited.
    Silence,
    /// A wait that ends, though there is no frame.
    Spurious,
    /// A call fails: `NODEV` when it is unplugged.
    WaitFails(Errno),
    DequeueFails(Errno),
    QueueFails(Errno),
}

/// A frame as the device sends it.
#[derive(Clone, Debug)]
pub(super) struct Sent {
    pub(super) number: u32,
    /// Rows with their margins.
    pub(super) bytes: Vec<u8>,
    pub(super) flags: u32,
    pub(super) timestamp_s: i64,
    pub(super) timestamp_us: i64,
}

impl Sent {
    pub(super) fn new(number: u32, bytes: Vec<u8>) -> Self {
        Self { number, bytes, flags: CLOCK_MONOTONIC, timestamp_s: i64::from(number), timestamp_us: 7 }
    }
}

/// The camera, and what it is that is plugged in: one for all that open it.
pub(super) struct Plug {
    pub(super) capabilities: u32,
    pub(super) formats: Vec<[u8; 4]>,
    /// Width and height; the first is what it falls back to.
    pub(super) sizes: Vec<(u32, u32)>,
    /// Listed in place of the sizes.
    pub(super) range: Option<[u32; 6]>,
    pub(super) lists_sizes: bool,
    pub(super) margin_bytes: u32,
    pub(super) says_stride: bool,
    /// Seconds a frame takes, whatever is asked for; none if it has no say.
    pub(super) interval: Option<(u32, u32)>,
    pub(super) n_buffers: u32,
    pub(super) set_format_fails: Option<Errno>,
    pub(super) open_fails: VecDeque<Errno>,
    pub(super) events: VecDeque<Event>,
    pub(super) rate_asked_for: Option<(u32, u32)>,
    /// How often it was opened, and is open.
    pub(super) n_opened: usize,
    pub(super) n_open: usize,
}

impl Plug {
    pub(super) fn new(formats: &[&[u8; 4]], sizes: &[(u32, u32)]) -> Rc<RefCell<Self>> {
        Rc::new(RefCell::new(Self {
            capabilities: CAN_CAPTURE | CAN_STREAM,
            formats: formats.iter().map(|format| **format).collect(),
            sizes: sizes.to_vec(),
            range: None,
            lists_sizes: true,
            margin_bytes: 0,
            says_stride: true,
            interval: None,
            n_buffers: 4,
            set_format_fails: None,
            open_fails: VecDeque::new(),
            events: VecDeque::new(),
            rate_asked_for: None,
            n_opened: 0,
            n_open: 0,
        }))
    }
}

/// Opens the camera. Whoever does so holds it to what the interface's specification demands of programs.
pub(super) fn open(plug: &Rc<RefCell<Plug>>, _path: &Path) -> io::Result<Box<dyn VideoDevice>> {
    let mut state = plug.borrow_mut();
    if let Some(errno) = state.open_fails.pop_front() {
        return Err(errno.into());
    }
    state.n_opened += 1;
    state.n_open += 1;
    Ok(Box::new(FakeCamera {
        plug: plug.clone(),
        n_requested: 0,
        memory: Vec::new(),
        queued: VecDeque::new(),
        is_streaming: false,
    }))
}

struct FakeCamera {
    plug: Rc<RefCell<Plug>>,
    n_requested: u32,
    memory: Vec<Vec<u8>>,
    queued: VecDeque<u32>,
    is_streaming: bool,
}

fn assert_of_capture(buffer: &Buffer) {
    assert_eq!((buffer.buffer_type, buffer.memory), (CAPTURE, MAPPED));
}

impl VideoDevice for FakeCamera {
    fn capability(&mut self) -> io::Result<Capability> {
        let device_capabilities = self.plug.borrow().capabilities;
        // All of the camera's device files together can more than this one.
        let capabilities = SAYS_OF_DEVICE | CAN_CAPTURE | CAN_STREAM;
        Ok(Capability { capabilities, device_capabilities, ..Capability::default() })
    }

    fn format(&mut self, wanted: FormatDescription) -> io::Result<FormatDescription> {
        assert_eq!(wanted.buffer_type, CAPTURE);
        let formats = &self.plug.borrow().formats;
        let format = formats.get(wanted.index as usize).ok_or(Errno::INVAL)?;
        Ok(FormatDescription { pixel_format: u32::from_le_bytes(*format), ..wanted })
    }

    fn size(&mut self, wanted: FrameSize) -> io::Result<FrameSize> {
        let plug = self.plug.borrow();
        assert!(plug.formats.contains(&wanted.pixel_format.to_le_bytes()));
        if !plug.lists_sizes {
            return Err(Errno::NOTTY.into());
        }
        if let (Some(size), 0) = (plug.range, wanted.index) {
            return Ok(FrameSize { size_type: 3, size, ..wanted });
        }
        let sizes = if plug.range.is_some() { &[][..] } else { &plug.sizes };
        let (width, height) = *sizes.get(wanted.index as usize).ok_or(Errno::INVAL)?;
        // What lies behind them in the union is whatever was there.
        Ok(FrameSize { size_type: ONE_SIZE, size: [width, height, 9, 9, 9, 9], ..wanted })
    }

    fn set_format(&mut self, mut wanted: Format) -> io::Result<Format> {
        assert_eq!((wanted.buffer_type, self.n_requested), (CAPTURE, 0));
        let plug = self.plug.borrow();
        if let Some(errno) = plug.set_format_fails {
            return Err(errno.into());
        }
        let pixels = &mut wanted.pixels;
        if !plug.formats.contains(&pixels.pixel_format.to_le_bytes()) {
            pixels.pixel_format = u32::from_le_bytes(plug.formats[0]);
        }
        if !plug.sizes.contains(&(pixels.width, pixels.height)) {
            (pixels.width, pixels.height) = plug.sizes[0];
        }
        let stride = pixels.width * 2 + plug.margin_bytes;
        pixels.bytes_per_line = if plug.says_stride { stride } else { 0 };
        pixels.size_image = stride * pixels.height;
        Ok(wanted)
    }

    fn set_parameters(&mut self, mut wanted: StreamParameters) -> io::Result<StreamParameters> {
        assert_eq!((wanted.buffer_type, self.n_requested), (CAPTURE, 0));
        let mut plug = self.plug.borrow_mut();
        plug.rate_asked_for = Some((wanted.numerator, wanted.denominator));
        if let Some((numerator, denominator)) = plug.interval {
            wanted.capability = CAN_SET_RATE;
            (wanted.numerator, wanted.denominator) = (numerator, denominator);
        }
        Ok(wanted)
    }

    fn request_buffers(&mut self, wanted: RequestBuffers) -> io::Result<RequestBuffers> {
        assert_eq!((wanted.buffer_type, wanted.memory), (CAPTURE, MAPPED));
        assert!(wanted.count >= 2);
        self.n_requested = self.plug.borrow().n_buffers;
        Ok(RequestBuffers { count: self.n_requested, ..wanted })
    }

    fn map(&mut self, wanted: Buffer) -> io::Result<()> {
        assert_of_capture(&wanted);
        assert_eq!(wanted.index as usize, self.memory.len());
        assert!(wanted.index < self.n_requested);
        self.memory.push(vec![0xee; 64]);
        Ok(())
    }

    fn queue(&mut self, buffer: Buffer) -> io::Result<()> {
        assert_of_capture(&buffer);
        assert!((buffer.index as usize) < self.memory.len());
        assert!(!self.queued.contains(&buffer.index), "a buffer is given away twice");
        let mut plug = self.plug.borrow_mut();
        if let Some(&Event::QueueFails(errno)) = plug.events.front() {
            plug.events.pop_front();
            return Err(errno.into());
        }
        self.queued.push_back(buffer.index);
        Ok(())
    }

    fn stream(&mut self, is_on: bool) -> io::Result<()> {
        assert_ne!(self.is_streaming, is_on);
        assert!(!is_on || self.queued.len() == self.n_requested as usize);
        self.is_streaming = is_on;
        Ok(())
    }

    fn wait(&mut self, timeout: Duration) -> io::Result<bool> {
        assert!(self.is_streaming);
        let mut plug = self.plug.borrow_mut();
        match plug.events.front() {
            Some(Event::Frame(_) | Event::Spurious | Event::DequeueFails(_)) => Ok(true),
            Some(&Event::WaitFails(errno)) => {
                plug.events.pop_front();
                Err(errno.into())
            }
            _ => {
                plug.events.pop_front();
                drop(plug);
                std::thread::sleep(timeout);
                Ok(false)
            }
        }
    }

    fn dequeue(&mut self, wanted: Buffer) -> io::Result<(Buffer, &[u8])> {
        assert_of_capture(&wanted);
        let event = self.plug.borrow_mut().events.pop_front();
        let sent = match event {
            Some(Event::Frame(sent)) => sent,
            Some(Event::DequeueFails(errno)) => return Err(errno.into()),
            _ => return Err(Errno::AGAIN.into()),
        };
        let index = self.queued.pop_front().expect("a buffer is given back after each frame");
        let memory = &mut self.memory[index as usize];
        memory.splice(..sent.bytes.len(), sent.bytes.iter().copied());
        let Sent { number, bytes, flags, timestamp_s, timestamp_us } = sent;
        let bytes_used = bytes.len() as u32;
        let buffer =
            Buffer { index, bytes_used, flags, timestamp_s, timestamp_us, sequence: number, ..wanted };
        Ok((buffer, &memory[..bytes.len()]))
    }
}

impl Drop for FakeCamera {
    fn drop(&mut self) {
        assert!(!self.is_streaming || std::thread::panicking(), "a stream is left running");
        self.plug.borrow_mut().n_open -= 1;
    }
}
