// Runs a program with a file that answers as a depth camera does: emulated_camera FILE ROWS COLUMNS PROGRAM ARGUMENTS…
//
// The program's calls of Video4Linux are handed to a second process (seccomp's user notification), which answers them by the structs of
// the system's header and writes frames to the file, which the program maps. Exit code 77: this is not possible here.
//
// Buffers are three; rows have a margin of 6 bytes. Reading c of row r of frame n is 1009 n + 31 r + c. Frame 5 is flagged as damaged,
// frame 6 never comes, and after frame 9 the camera is unplugged. Opened again, it counts anew and sends such frames without end.
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <linux/videodev2.h>
#include <poll.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

enum { N_BUFFERS = 3, MARGIN = 6, BUFFER_BYTES = 1 << 16 };

static uint32_t n_rows, n_columns;
static int file;
static uint32_t queued[N_BUFFERS], n_queued;
static int is_on, n_streams;
static uint32_t number;

static uint32_t stride(void) { return n_columns * 2 + MARGIN; }

static void write_frame(uint32_t buffer) {
    static unsigned char bytes[BUFFER_BYTES];
    memset(bytes, 0xaa, sizeof bytes);
    for (uint32_t row = 0; row < n_rows; row++)
        for (uint32_t column = 0; column < n_columns; column++) {
            uint16_t count = (uint16_t)(number * 1009 + row * 31 + column);
            memcpy(bytes + row * stride() + column * 2, &count, 2);
        }
    if (pwrite(file, bytes, sizeof bytes, (off_t)buffer * BUFFER_BYTES) != sizeof bytes) abort();
}

static int is_ours(const struct v4l2_buffer *buffer) {
    return buffer->type == V4L2_BUF_TYPE_VIDEO_CAPTURE && buffer->memory == V4L2_MEMORY_MMAP;
}

static int dequeue(struct v4l2_buffer *buffer) {
    if (!is_ours(buffer) || !is_on) return EINVAL;
    usleep(10000);
    if (n_streams == 1 && number == 10) return ENODEV;
    if (n_queued == 0) return EAGAIN;
    if (n_streams == 1 && number == 6) number++;
    uint32_t index = queued[0];
    memmove(queued, queued + 1, --n_queued * sizeof *queued);
    write_frame(index);
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    *buffer = (struct v4l2_buffer){.index = index,
                                   .type = V4L2_BUF_TYPE_VIDEO_CAPTURE,
                                   .memory = V4L2_MEMORY_MMAP,
                                   .bytesused = n_rows * stride(),
                                   .flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC,
                                   .timestamp = {now.tv_sec, now.tv_nsec / 1000},
                                   .sequence = number,
                                   .length = BUFFER_BYTES};
    if (n_streams == 1 && number == 5) buffer->flags |= V4L2_BUF_FLAG_ERROR;
    number++;
    return 0;
}

// Answers a call whose argument has been copied here. Returns what becomes of it: an error's number, or 0.
static int answer(uint32_t request, void *argument) {
    struct v4l2_buffer *buffer = argument;
    switch (request) {
    case VIDIOC_QUERYCAP: {
        struct v4l2_capability *capability = argument;
        is_on = n_queued = 0;
        capability->capabilities = capability->device_caps = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
        return 0;
    }
    case VIDIOC_ENUM_FMT: {
        struct v4l2_fmtdesc *format = argument;
        if (format->type != V4L2_BUF_TYPE_VIDEO_CAPTURE || format->index > 1) return EINVAL;
        format->pixelformat = format->index == 0 ? V4L2_PIX_FMT_UYVY : V4L2_PIX_FMT_Z16;
        return 0;
    }
    case VIDIOC_S_FMT: {
        struct v4l2_format *format = argument;
        if (format->type != V4L2_BUF_TYPE_VIDEO_CAPTURE) return EINVAL;
        format->fmt.pix.width = n_columns;
        format->fmt.pix.height = n_rows;
        format->fmt.pix.pixelformat = V4L2_PIX_FMT_Z16;
        format->fmt.pix.bytesperline = stride();
        return 0;
    }
    case VIDIOC_ENUM_FRAMESIZES: {
        struct v4l2_frmsizeenum *size = argument;
        if (size->pixel_format != V4L2_PIX_FMT_Z16 || size->index > 0) return EINVAL;
        size->type = V4L2_FRMSIZE_TYPE_DISCRETE;
        size->discrete = (struct v4l2_frmsize_discrete){n_columns, n_rows};
        return 0;
    }
    case VIDIOC_S_PARM: {
        struct v4l2_streamparm *parameters = argument;
        parameters->parm.capture.capability = V4L2_CAP_TIMEPERFRAME;
        parameters->parm.capture.timeperframe = (struct v4l2_fract){1, 90};
        return parameters->type == V4L2_BUF_TYPE_VIDEO_CAPTURE ? 0 : EINVAL;
    }
    case VIDIOC_REQBUFS: {
        struct v4l2_requestbuffers *buffers = argument;
        if (buffers->type != V4L2_BUF_TYPE_VIDEO_CAPTURE || buffers->memory != V4L2_MEMORY_MMAP) return EINVAL;
        buffers->count = N_BUFFERS;
        return 0;
    }
    case VIDIOC_QUERYBUF:
        if (!is_ours(buffer) || buffer->index >= N_BUFFERS) return EINVAL;
        buffer->m.offset = buffer->index * BUFFER_BYTES;
        buffer->length = BUFFER_BYTES;
        return 0;
    case VIDIOC_QBUF:
        if (!is_ours(buffer) || buffer->index >= N_BUFFERS || n_queued == N_BUFFERS) return EINVAL;
        queued[n_queued++] = buffer->index;
        return 0;
    case VIDIOC_DQBUF:
        return dequeue(buffer);
    case VIDIOC_STREAMON:
        if (*(int *)argument != V4L2_BUF_TYPE_VIDEO_CAPTURE) return EINVAL;
        is_on = 1;
        number = 0;
        n_streams++;
        return 0;
    case VIDIOC_STREAMOFF:
        if (*(int *)argument != V4L2_BUF_TYPE_VIDEO_CAPTURE) return EINVAL;
        is_on = n_queued = 0;
        return 0;
    default:
        return ENOTTY;
    }
}

// Answers until the program has ended.
static void serve(int calls) {
    for (;;) {
        struct pollfd ready = {.fd = calls, .events = POLLIN};
        if (poll(&ready, 1, -1) < 0 || !(ready.revents & POLLIN)) _exit(0);
        struct seccomp_notif call = {0};
        if (ioctl(calls, SECCOMP_IOCTL_NOTIF_RECV, &call) != 0) continue;
        uint32_t request = (uint32_t)call.data.args[1];
        char argument[256] __attribute__((aligned(8)));
        struct iovec here = {argument, _IOC_SIZE(request) <= sizeof argument ? _IOC_SIZE(request) : 0};
        struct iovec there = {(void *)(uintptr_t)call.data.args[2], here.iov_len};
        struct seccomp_notif_resp response = {.id = call.id};
        if (process_vm_readv((pid_t)call.pid, &here, 1, &there, 1, 0) != (ssize_t)here.iov_len) response.error = -EFAULT;
        else response.error = -answer(request, argument);
        if (response.error == 0 && process_vm_writev((pid_t)call.pid, &here, 1, &there, 1, 0) != (ssize_t)here.iov_len)
            response.error = -EFAULT;
        ioctl(calls, SECCOMP_IOCTL_NOTIF_SEND, &response);
    }
}

static int impossible(const char *what) {
    perror(what);
    return 77;
}

int main(int argc, char **argv) {
    if (argc < 5) return 2;
    file = open(argv[1], O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    n_rows = (uint32_t)atoi(argv[2]);
    n_columns = (uint32_t)atoi(argv[3]);
    if (file < 0 || ftruncate(file, N_BUFFERS * BUFFER_BYTES) != 0 || n_rows * stride() > BUFFER_BYTES) return 2;
    struct sock_filter filter[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, __NR_ioctl, 0, 5),
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, args[1])),
        BPF_STMT(BPF_ALU | BPF_RSH | BPF_K, 8),
        BPF_STMT(BPF_ALU | BPF_AND | BPF_K, 0xff),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, 'V', 0, 1),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_USER_NOTIF),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
    };
    struct sock_fprog program = {.len = sizeof filter / sizeof *filter, .filter = filter};
    int pair[2];
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, pair) != 0) return impossible("socketpair");
    union {
        struct cmsghdr header;
        char bytes[CMSG_SPACE(sizeof(int))];
    } control = {0};
    char byte = 0;
    struct iovec payload = {&byte, 1};
    struct msghdr message = {.msg_iov = &payload, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
    switch (fork()) {
    case -1:
        return impossible("fork");
    case 0:
        // What the program prints ends with the program.
        for (int fd = 0; fd < 3; fd++) close(fd);
        close(pair[0]);
        if (recvmsg(pair[1], &message, 0) != 1 || CMSG_FIRSTHDR(&message) == NULL) _exit(1);
        int calls;
        memcpy(&calls, CMSG_DATA(CMSG_FIRSTHDR(&message)), sizeof calls);
        serve(calls);
    }
    prctl(PR_SET_PTRACER, PR_SET_PTRACER_ANY, 0, 0, 0);
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) return impossible("no new privileges");
    int calls = (int)syscall(SYS_seccomp, SECCOMP_SET_MODE_FILTER, SECCOMP_FILTER_FLAG_NEW_LISTENER, &program);
    if (calls < 0) return impossible("seccomp");
    control.header = (struct cmsghdr){.cmsg_level = SOL_SOCKET, .cmsg_type = SCM_RIGHTS, .cmsg_len = CMSG_LEN(sizeof calls)};
    memcpy(CMSG_DATA(&control.header), &calls, sizeof calls);
    if (sendmsg(pair[0], &message, 0) != 1) return impossible("sendmsg");
    close(calls);
    execv(argv[4], argv + 4);
    return impossible(argv[4]);
}
