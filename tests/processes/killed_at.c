// A library that kills the program it is loaded into (LD_PRELOAD) as it is about to make a certain call: of those that change what
// other programs find in files and shared memory, the KILLED_AT-th. Without KILLED_AT it counts them, and writes how many there
// were into the file COUNTED at the end.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

static long n_calls;

static void count(void) {
    const char *killed_at = getenv("KILLED_AT");
    long call = __atomic_add_fetch(&n_calls, 1, __ATOMIC_SEQ_CST);
    if (killed_at && call == atol(killed_at)) {
        kill(getpid(), SIGKILL);
    }
}

__attribute__((destructor)) static void tell(void) {
    const char *counted = getenv("COUNTED");
    FILE *file = counted ? fopen(counted, "w") : NULL;
    if (file) {
        fprintf(file, "%ld", n_calls);
        fclose(file);
    }
}

#define NEXT(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

int shm_open(const char *name, int flags, mode_t mode) {
    if (flags & O_CREAT) count();
    return NEXT(shm_open)(name, flags, mode);
}

int open(const char *path, int flags, ...) {
    va_list rest;
    va_start(rest, flags);
    mode_t mode = va_arg(rest, mode_t);
    va_end(rest);
    if (flags & O_CREAT) count();
    return NEXT(open)(path, flags, mode);
}

ssize_t write(int file, const void *bytes, size_t length) {
    if (file > STDERR_FILENO) count();
    return NEXT(write)(file, bytes, length);
}

#define COUNTED_CALL(name, parameters, ...) \
    int name parameters {                   \
        count();                            \
        return NEXT(name)(__VA_ARGS__);     \
    }

COUNTED_CALL(shm_unlink, (const char *name), name)
COUNTED_CALL(ftruncate, (int file, off_t length), file, length)
COUNTED_CALL(fchmod, (int file, mode_t mode), file, mode)
COUNTED_CALL(mkdir, (const char *path, mode_t mode), path, mode)
COUNTED_CALL(rmdir, (const char *path), path)
COUNTED_CALL(unlink, (const char *path), path)
COUNTED_CALL(remove, (const char *path), path)
COUNTED_CALL(bind, (int socket, const struct sockaddr *address, socklen_t length), socket, address, length)
