// Prints what videodev2.h says of calls and of what they carry, in the order in which tests.rs expects it.
#include <linux/videodev2.h>
#include <stddef.h>
#include <stdio.h>

#define PRINT(name, value) printf("%s %llu\n", name, (unsigned long long)(value))
#define CALL(name) PRINT(#name, VIDIOC_##name)
#define FIELD(type, field) PRINT(#type "." #field, offsetof(struct v4l2_##type, field))
#define FIELD_OF(type, part, field) PRINT(#type "." #field, offsetof(struct v4l2_##type, part.field))

int main(void) {
    CALL(QUERYCAP);
    CALL(ENUM_FMT);
    CALL(S_FMT);
    CALL(REQBUFS);
    CALL(QUERYBUF);
    CALL(QBUF);
    CALL(DQBUF);
    CALL(STREAMON);
    CALL(STREAMOFF);
    CALL(S_PARM);
    CALL(ENUM_FRAMESIZES);
    PRINT("CAPTURE", V4L2_BUF_TYPE_VIDEO_CAPTURE);
    PRINT("MAPPED", V4L2_MEMORY_MMAP);
    PRINT("CAN_CAPTURE", V4L2_CAP_VIDEO_CAPTURE);
    PRINT("CAN_STREAM", V4L2_CAP_STREAMING);
    PRINT("SAYS_OF_DEVICE", V4L2_CAP_DEVICE_CAPS);
    PRINT("CAN_SET_RATE", V4L2_CAP_TIMEPERFRAME);
    PRINT("ONE_SIZE", V4L2_FRMSIZE_TYPE_DISCRETE);
    PRINT("DAMAGED", V4L2_BUF_FLAG_ERROR);
    PRINT("CLOCK", V4L2_BUF_FLAG_TIMESTAMP_MASK);
    PRINT("CLOCK_MONOTONIC", V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC);
    PRINT("Z16", V4L2_PIX_FMT_Z16);
    PRINT("Y16", V4L2_PIX_FMT_Y16);
    FIELD(capability, driver);
    FIELD(capability, capabilities);
    FIELD(capability, device_caps);
    FIELD(fmtdesc, index);
    FIELD(fmtdesc, type);
    FIELD(fmtdesc, pixelformat);
    FIELD(frmsizeenum, index);
    FIELD(frmsizeenum, pixel_format);
    FIELD(frmsizeenum, type);
    FIELD(frmsizeenum, discrete.width);
    FIELD(frmsizeenum, discrete.height);
    FIELD(frmsizeenum, stepwise.min_width);
    FIELD(frmsizeenum, stepwise.max_width);
    FIELD(frmsizeenum, stepwise.step_width);
    FIELD(frmsizeenum, stepwise.min_height);
    FIELD(frmsizeenum, stepwise.max_height);
    FIELD(frmsizeenum, stepwise.step_height);
    FIELD(format, type);
    FIELD_OF(format, fmt, pix.width);
    FIELD_OF(format, fmt, pix.height);
    FIELD_OF(format, fmt, pix.pixelformat);
    FIELD_OF(format, fmt, pix.bytesperline);
    FIELD_OF(format, fmt, pix.xfer_func);
    FIELD(streamparm, type);
    FIELD_OF(streamparm, parm.capture, capability);
    FIELD_OF(streamparm, parm.capture.timeperframe, numerator);
    FIELD_OF(streamparm, parm.capture.timeperframe, denominator);
    FIELD(requestbuffers, count);
    FIELD(requestbuffers, type);
    FIELD(requestbuffers, memory);
    FIELD(buffer, index);
    FIELD(buffer, type);
    FIELD(buffer, bytesused);
    FIELD(buffer, flags);
    FIELD(buffer, timestamp.tv_sec);
    FIELD(buffer, timestamp.tv_usec);
    FIELD(buffer, sequence);
    FIELD(buffer, memory);
    FIELD_OF(buffer, m, offset);
    FIELD(buffer, length);
}
