//! A video device as the system shows it.

use std::io;
use std::time::Duration;

use super::abi::{
    Buffer, Capability, Format, FormatDescription, FrameSize, RequestBuffers, StreamParameters,
};

/// The calls of Video4Linux that reading depth takes, one each and nothing besides: what is asked for when is its caller's.
///
/// An argument comes back as the driver has changed it. Errors are the system's.
pub(crate) trait VideoDevice {
    /// What it is (`QUERYCAP`).
    fn capability(&mut self) -> io::Result<Capability>;
    /// A format that it has, by `index` (`ENUM_FMT`); `EINVAL` beyond the last.
    fn format(&mut self, wanted: FormatDescription) -> io::Result<FormatDescription>;
    /// Frames' size in a format, by `index` (`ENUM_FRAMESIZES`); `EINVAL` beyond the last.
    fn size(&mut self, wanted: FrameSize) -> io::Result<FrameSize>;
    /// Sets the format, or the one that is nearest (`S_FMT`).
    fn set_format(&mut self, wanted: Format) -> io::Result<Format>;
    /// Sets the rate, or the one that is nearest (`S_PARM`).
    fn set_parameters(&mut self, wanted: StreamParameters) -> io::Result<StreamParameters>;
    /// Makes buffers, perhaps more or fewer than wanted (`REQBUFS`).
    fn request_buffers(&mut self, wanted: RequestBuffers) -> io::Result<RequestBuffers>;
    /// Maps one of them (`QUERYBUF`, `mmap`). Called for each, in their order.
    fn map(&mut self, wanted: Buffer) -> io::Result<()>;
    /// Gives a buffer to the device, which writes to it (`QBUF`).
    fn queue(&mut self, buffer: Buffer) -> io::Result<()>;
    /// Frames begin or end to come (`STREAMON`, `STREAMOFF`).
    fn stream(&mut self, is_on: bool) -> io::Result<()>;
    /// Waits until a buffer can be taken back, and returns whether one can. An error if none ever will.
    fn wait(&mut self, timeout: Duration) -> io::Result<bool>;
    /// Takes back a buffer that was written to (`DQBUF`), with its `bytes_used`, at most as many as are mapped; does not wait.
    fn dequeue(&mut self, wanted: Buffer) -> io::Result<(Buffer, &[u8])>;
}
