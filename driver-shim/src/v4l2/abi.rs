//! What `linux/videodev2.h` says, as far as it is needed here: the calls, and what they read and write.
//!
//! Structs have the names that the header gives them without `v4l2_`. All are of whole numbers, so any bytes are a value. Their sizes
//! are those of 64-bit machines, which are asserted below; a test has a C compiler compare each field with the header.

use std::ffi::c_int;
use std::marker::PhantomData;

use rustix::ioctl::{Opcode, opcode};

/// A call, and the type of what it reads and writes.
pub(crate) struct Call<T> {
    opcode: Opcode,
    argument: PhantomData<T>,
}

impl<T> Call<T> {
    const fn new(opcode: Opcode) -> Self {
        Self { opcode, argument: PhantomData }
    }

    const fn read(number: u8) -> Self {
        Self::new(opcode::read::<T>(b'V', number))
    }

    const fn write(number: u8) -> Self {
        Self::new(opcode::write::<T>(b'V', number))
    }

    const fn read_write(number: u8) -> Self {
        Self::new(opcode::read_write::<T>(b'V', number))
    }

    pub(crate) fn opcode(&self) -> Opcode {
        self.opcode
    }
}

pub(crate) const QUERYCAP: Call<Capability> = Call::read(0);
pub(crate) const ENUM_FMT: Call<FormatDescription> = Call::read_write(2);
pub(crate) const S_FMT: Call<Format> = Call::read_write(5);
pub(crate) const REQBUFS: Call<RequestBuffers> = Call::read_write(8);
pub(crate) const QUERYBUF: Call<Buffer> = Call::read_write(9);
pub(crate) const QBUF: Call<Buffer> = Call::read_write(15);
pub(crate) const DQBUF: Call<Buffer> = Call::read_write(17);
pub(crate) const STREAMON: Call<c_int> = Call::write(18);
pub(crate) const STREAMOFF: Call<c_int> = Call::write(19);
pub(crate) const S_PARM: Call<StreamParameters> = Call::read_write(22);
pub(crate) const ENUM_FRAMESIZES: Call<FrameSize> = Call::read_write(74);

/// `V4L2_BUF_TYPE_VIDEO_CAPTURE`.
pub(crate) const CAPTURE: u32 = 1;
/// `V4L2_MEMORY_MMAP`.
pub(crate) const MAPPED: u32 = 1;
/// `V4L2_CAP_VIDEO_CAPTURE`.
pub(crate) const CAN_CAPTURE: u32 = 1;
/// `V4L2_CAP_STREAMING`.
pub(crate) const CAN_STREAM: u32 = 0x0400_0000;
/// `V4L2_CAP_DEVICE_CAPS`: `device_capabilities` is filled in.
pub(crate) const SAYS_OF_DEVICE: u32 = 0x8000_0000;
/// `V4L2_CAP_TIMEPERFRAME`.
pub(crate) const CAN_SET_RATE: u32 = 0x1000;
/// `V4L2_FRMSIZE_TYPE_DISCRETE`; the other two are ranges.
pub(crate) const ONE_SIZE: u32 = 1;
/// `V4L2_BUF_FLAG_ERROR`.
pub(crate) const DAMAGED: u32 = 0x40;
/// `V4L2_BUF_FLAG_TIMESTAMP_MASK`.
pub(crate) const CLOCK: u32 = 0xe000;
/// `V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC`.
pub(crate) const CLOCK_MONOTONIC: u32 = 0x2000;

#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Capability {
    pub(crate) driver: [u8; 16],
    pub(crate) card: [u8; 32],
    pub(crate) bus_info: [u8; 32],
    pub(crate) version: u32,
    pub(crate) capabilities: u32,
    pub(crate) device_capabilities: u32,
    pub(crate) reserved: [u32; 3],
}

/// `v4l2_fmtdesc`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FormatDescription {
    pub(crate) index: u32,
    pub(crate) buffer_type: u32,
    pub(crate) flags: u32,
    pub(crate) description: [u8; 32],
    pub(crate) pixel_format: u32,
    pub(crate) media_bus_code: u32,
    pub(crate) reserved: [u32; 3],
}

/// `v4l2_frmsizeenum`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FrameSize {
    pub(crate) index: u32,
    pub(crate) pixel_format: u32,
    pub(crate) size_type: u32,
    /// Width and height; of a range, least, most and step of the width, then of the height.
    pub(crate) size: [u32; 6],
    pub(crate) reserved: [u32; 2],
}

/// `v4l2_format`, whose union is aligned for pointers.
#[repr(C, align(8))]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Format {
    pub(crate) buffer_type: u32,
    pub(crate) padding: u32,
    pub(crate) pixels: PixelFormat,
    pub(crate) rest_of_union: [[u32; 19]; 2],
}

/// `v4l2_pix_format`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PixelFormat {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) pixel_format: u32,
    pub(crate) field: u32,
    /// From a row's first byte to the next row's; 0 where rows follow each other.
    pub(crate) bytes_per_line: u32,
    pub(crate) size_image: u32,
    pub(crate) color_space: u32,
    pub(crate) private: u32,
    pub(crate) flags: u32,
    pub(crate) encoding: u32,
    pub(crate) quantization: u32,
    pub(crate) transfer_function: u32,
}

/// `v4l2_streamparm`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StreamParameters {
    pub(crate) buffer_type: u32,
    pub(crate) capability: u32,
    pub(crate) capture_mode: u32,
    /// Seconds from a frame to the next, as a fraction.
    pub(crate) numerator: u32,
    pub(crate) denominator: u32,
    pub(crate) extended_mode: u32,
    pub(crate) read_buffers: u32,
    pub(crate) reserved: [u32; 4],
    pub(crate) rest_of_union: [[u32; 20]; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RequestBuffers {
    pub(crate) count: u32,
    pub(crate) buffer_type: u32,
    pub(crate) memory: u32,
    pub(crate) capabilities: u32,
    pub(crate) flags: u8,
    pub(crate) reserved: [u8; 3],
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Buffer {
    pub(crate) index: u32,
    pub(crate) buffer_type: u32,
    pub(crate) bytes_used: u32,
    pub(crate) flags: u32,
    pub(crate) field: u32,
    pub(crate) padding: u32,
    /// Of `CLOCK_MONOTONIC`, if `flags` say so.
    pub(crate) timestamp_s: i64,
    pub(crate) timestamp_us: i64,
    pub(crate) time_code: [u32; 4],
    pub(crate) sequence: u32,
    pub(crate) memory: u32,
    /// Where in the device's file it can be mapped; a union with pointers.
    pub(crate) offset: u64,
    pub(crate) length: u32,
    pub(crate) reserved: [u32; 3],
}

// What a call's number holds of it, so that another size would be another call.
const _: () = {
    assert!(size_of::<usize>() == 8, "on machines of 32 bits the header has other sizes");
    assert!(size_of::<Capability>() == 104);
    assert!(size_of::<FormatDescription>() == 64);
    assert!(size_of::<FrameSize>() == 44);
    assert!(size_of::<PixelFormat>() == 48);
    assert!(size_of::<Format>() == 208);
    assert!(size_of::<StreamParameters>() == 204);
    assert!(size_of::<RequestBuffers>() == 20);
    assert!(size_of::<Buffer>() == 88);
};

#[cfg(test)]
mod tests {
    #![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

    use std::mem::offset_of;
    use std::process::Command;

    use super::*;

    #[test]
    fn calls_and_what_they_carry_are_those_of_the_systems_header() {
        let folder = tempfile::tempdir().unwrap();
        let source = folder.path().join("sizes.c");
        let program = folder.path().join("sizes");
        std::fs::write(&source, include_str!("abi_test.c")).unwrap();
        let compiled = Command::new("cc").arg("-o").arg(&program).arg(&source).output();
        let Ok(compiled) = compiled else {
            eprintln!("skipped: there is no C compiler");
            return;
        };
        let said = String::from_utf8_lossy(&compiled.stderr);
        if said.contains("videodev2.h: No such file") {
            eprintln!("skipped: there is no linux/videodev2.h");
            return;
        }
        assert!(compiled.status.success(), "{said}");
        let printed = String::from_utf8(Command::new(&program).output().unwrap().stdout).unwrap();
        let printed: Vec<(&str, u64)> = printed
            .lines()
            .map(|line| line.split_once(' ').map(|(name, number)| (name, number.parse().unwrap())).unwrap())
            .collect();
        assert_eq!(printed, numbers());
    }

    /// What `abi_test.c` prints, in its order.
    fn numbers() -> Vec<(&'static str, u64)> {
        let at = |offset: usize| offset as u64;
        let pixels = offset_of!(Format, pixels);
        vec![
            ("QUERYCAP", QUERYCAP.opcode().into()),
            ("ENUM_FMT", ENUM_FMT.opcode().into()),
            ("S_FMT", S_FMT.opcode().into()),
            ("REQBUFS", REQBUFS.opcode().into()),
            ("QUERYBUF", QUERYBUF.opcode().into()),
            ("QBUF", QBUF.opcode().into()),
            ("DQBUF", DQBUF.opcode().into()),
            ("STREAMON", STREAMON.opcode().into()),
            ("STREAMOFF", STREAMOFF.opcode().into()),
            ("S_PARM", S_PARM.opcode().into()),
            ("ENUM_FRAMESIZES", ENUM_FRAMESIZES.opcode().into()),
            ("CAPTURE", CAPTURE.into()),
            ("MAPPED", MAPPED.into()),
            ("CAN_CAPTURE", CAN_CAPTURE.into()),
            ("CAN_STREAM", CAN_STREAM.into()),
            ("SAYS_OF_DEVICE", SAYS_OF_DEVICE.into()),
            ("CAN_SET_RATE", CAN_SET_RATE.into()),
            ("ONE_SIZE", ONE_SIZE.into()),
            ("DAMAGED", DAMAGED.into()),
            ("CLOCK", CLOCK.into()),
            ("CLOCK_MONOTONIC", CLOCK_MONOTONIC.into()),
            ("Z16", u32::from_le_bytes(*b"Z16 ").into()),
            ("Y16", u32::from_le_bytes(*b"Y16 ").into()),
            ("capability.driver", at(offset_of!(Capability, driver))),
            ("capability.capabilities", at(offset_of!(Capability, capabilities))),
            ("capability.device_caps", at(offset_of!(Capability, device_capabilities))),
            ("fmtdesc.index", at(offset_of!(FormatDescription, index))),
            ("fmtdesc.type", at(offset_of!(FormatDescription, buffer_type))),
            ("fmtdesc.pixelformat", at(offset_of!(FormatDescription, pixel_format))),
            ("frmsizeenum.index", at(offset_of!(FrameSize, index))),
            ("frmsizeenum.pixel_format", at(offset_of!(FrameSize, pixel_format))),
            ("frmsizeenum.type", at(offset_of!(FrameSize, size_type))),
            ("frmsizeenum.discrete.width", at(offset_of!(FrameSize, size))),
            ("frmsizeenum.discrete.height", at(offset_of!(FrameSize, size)) + 4),
            ("frmsizeenum.stepwise.min_width", at(offset_of!(FrameSize, size))),
            ("frmsizeenum.stepwise.max_width", at(offset_of!(FrameSize, size)) + 4),
            ("frmsizeenum.stepwise.step_width", at(offset_of!(FrameSize, size)) + 8),
            ("frmsizeenum.stepwise.min_height", at(offset_of!(FrameSize, size)) + 12),
            ("frmsizeenum.stepwise.max_height", at(offset_of!(FrameSize, size)) + 16),
            ("frmsizeenum.stepwise.step_height", at(offset_of!(FrameSize, size)) + 20),
            ("format.type", at(offset_of!(Format, buffer_type))),
            ("format.pix.width", at(pixels + offset_of!(PixelFormat, width))),
            ("format.pix.height", at(pixels + offset_of!(PixelFormat, height))),
            ("format.pix.pixelformat", at(pixels + offset_of!(PixelFormat, pixel_format))),
            ("format.pix.bytesperline", at(pixels + offset_of!(PixelFormat, bytes_per_line))),
            ("format.pix.xfer_func", at(pixels + offset_of!(PixelFormat, transfer_function))),
            ("streamparm.type", at(offset_of!(StreamParameters, buffer_type))),
            ("streamparm.capability", at(offset_of!(StreamParameters, capability))),
            ("streamparm.numerator", at(offset_of!(StreamParameters, numerator))),
            ("streamparm.denominator", at(offset_of!(StreamParameters, denominator))),
            ("requestbuffers.count", at(offset_of!(RequestBuffers, count))),
            ("requestbuffers.type", at(offset_of!(RequestBuffers, buffer_type))),
            ("requestbuffers.memory", at(offset_of!(RequestBuffers, memory))),
            ("buffer.index", at(offset_of!(Buffer, index))),
            ("buffer.type", at(offset_of!(Buffer, buffer_type))),
            ("buffer.bytesused", at(offset_of!(Buffer, bytes_used))),
            ("buffer.flags", at(offset_of!(Buffer, flags))),
            ("buffer.timestamp.tv_sec", at(offset_of!(Buffer, timestamp_s))),
            ("buffer.timestamp.tv_usec", at(offset_of!(Buffer, timestamp_us))),
            ("buffer.sequence", at(offset_of!(Buffer, sequence))),
            ("buffer.memory", at(offset_of!(Buffer, memory))),
            ("buffer.offset", at(offset_of!(Buffer, offset))),
            ("buffer.length", at(offset_of!(Buffer, length))),
        ]
    }
}
