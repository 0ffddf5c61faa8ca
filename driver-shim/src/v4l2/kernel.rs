//! A video device of the kernel: what calls it, and reads the memory that it writes to.
#![allow(
    unsafe_code,
    reason = "calls of the kernel whose arguments only its header describes, and memory that it writes"
)]

use std::ffi::{c_int, c_void};
use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::ptr;
use std::time::Duration;

use memmap2::{MmapOptions, MmapRaw};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::OFlags;
use rustix::io::Errno;
use rustix::ioctl::{Ioctl, IoctlOutput, Opcode, ioctl};

use super::abi::{
    self, Buffer, CAPTURE, Call, Capability, Format, FormatDescription, FrameSize, RequestBuffers,
    StreamParameters,
};
use super::video_device::VideoDevice;

/// A device file, and those of its buffers that are mapped.
pub(crate) struct KernelDevice {
    file: File,
    buffers: Vec<MmapRaw>,
}

impl KernelDevice {
    pub(crate) fn open(path: &Path) -> io::Result<Self> {
        // Drivers may ask to be opened for writing, too, though nothing is written.
        let mut options = OpenOptions::new();
        options.read(true).write(true).custom_flags(OFlags::NONBLOCK.bits() as i32);
        Ok(Self { file: options.open(path)?, buffers: Vec::new() })
    }

    fn call<T>(&self, call: Call<T>, mut argument: T) -> io::Result<T> {
        let request = Request { opcode: call.opcode(), argument: &mut argument };
        // SAFETY: calls are made in `abi` alone, each for the type that the kernel's header gives it, so the kernel reads and
        // writes within `argument`, which is of whole numbers and holds whatever is written. Of these types only a buffer's union
        // may be a pointer, and is an offset instead, since the memory asked for is to be mapped (`V4L2_MEMORY_MMAP`). A file that
        // is no video device refuses numbers of this group ('V'), or has its own by them: then it is one that a person named as a
        // camera, and what it writes is still of the size in the number.
        unsafe { ioctl(&self.file, request) }?;
        Ok(argument)
    }
}

/// A call with its argument, as rustix makes it.
struct Request<'a, T> {
    opcode: Opcode,
    argument: &'a mut T,
}

// SAFETY: the pointer is that of the argument, which outlives the call and may be written to. Nothing is read by it afterwards.
unsafe impl<T> Ioctl for Request<'_, T> {
    type Output = ();

    const IS_MUTATING: bool = true;

    fn opcode(&self) -> Opcode {
        self.opcode
    }

    fn as_ptr(&mut self) -> *mut c_void {
        ptr::from_mut(self.argument).cast()
    }

    unsafe fn output_from_ptr(_: IoctlOutput, _: *mut c_void) -> rustix::io::Result<()> {
        Ok(())
    }
}

impl VideoDevice for KernelDevice {
    fn capability(&mut self) -> io::Result<Capability> {
        self.call(abi::QUERYCAP, Capability::default())
    }

    fn format(&mut self, wanted: FormatDescription) -> io::Result<FormatDescription> {
        self.call(abi::ENUM_FMT, wanted)
    }

    fn size(&mut self, wanted: FrameSize) -> io::Result<FrameSize> {
        self.call(abi::ENUM_FRAMESIZES, wanted)
    }

    fn set_format(&mut self, wanted: Format) -> io::Result<Format> {
        self.call(abi::S_FMT, wanted)
    }

    fn set_parameters(&mut self, wanted: StreamParameters) -> io::Result<StreamParameters> {
        self.call(abi::S_PARM, wanted)
    }

    fn request_buffers(&mut self, wanted: RequestBuffers) -> io::Result<RequestBuffers> {
        self.call(abi::REQBUFS, wanted)
    }

    fn map(&mut self, wanted: Buffer) -> io::Result<()> {
        let buffer = self.call(abi::QUERYBUF, wanted)?;
        let mut options = MmapOptions::new();
        options.offset(buffer.offset).len(buffer.length as usize);
        self.buffers.push(options.map_raw_read_only(&self.file)?);
        Ok(())
    }

    fn queue(&mut self, buffer: Buffer) -> io::Result<()> {
        self.call(abi::QBUF, buffer).map(drop)
    }

    fn stream(&mut self, is_on: bool) -> io::Result<()> {
        let call = if is_on { abi::STREAMON } else { abi::STREAMOFF };
        self.call(call, CAPTURE as c_int).map(drop)
    }

    fn wait(&mut self, timeout: Duration) -> io::Result<bool> {
        let mut fds = [PollFd::new(&self.file, PollFlags::IN)];
        match poll(&mut fds, Timespec::try_from(timeout).ok().as_ref()) {
            Err(Errno::INTR) => return Ok(false),
            polled => polled?,
        };
        let seen = fds[0].revents();
        if !seen.contains(PollFlags::IN) && seen.intersects(PollFlags::ERR | PollFlags::HUP) {
            // Whoever waited again would be woken at once, for ever.
            return Err(Errno::NODEV.into());
        }
        Ok(seen.contains(PollFlags::IN))
    }

    fn dequeue(&mut self, wanted: Buffer) -> io::Result<(Buffer, &[u8])> {
        let buffer = self.call(abi::DQBUF, wanted)?;
        let mapped = self.buffers.get(buffer.index as usize);
        let mapped =
            mapped.ok_or_else(|| io::Error::other("its driver hands out a buffer that there is not"))?;
        let n_bytes = mapped.len().min(buffer.bytes_used as usize);
        // SAFETY: these bytes are mapped for as long as `self` is borrowed, also when the device is unplugged: the kernel keeps the
        // pages until the last mapping goes. A buffer that was taken back is written to by nobody until it is queued, which
        // borrows `self` anew. A driver that breaks this rule of the interface would break any reader.
        Ok((buffer, unsafe { std::slice::from_raw_parts(mapped.as_ptr(), n_bytes) }))
    }
}
