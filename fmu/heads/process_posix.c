/* The Python process of an instance on Linux and macOS: one socket for requests and answers, which is its standard input,
 * and one pipe for what it prints. */

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>
#if defined(__APPLE__)
#include <crt_externs.h>
#include <dlfcn.h>
#define FP_ENVIRON (*_NSGetEnviron())
#define FP_SEND_FLAGS 0
#else
#include <link.h>
extern char **environ;
#define FP_ENVIRON environ
#define FP_SEND_FLAGS MSG_NOSIGNAL
#endif

#define FP_ON_PATH "python3"

typedef struct {
  pid_t pid, parent;
  int channel, prints;
  fp_text printed;
} fp_child;

static const char *fp_environment(const char *name) { return getenv(name); }
static FILE *fp_open(const char *path) { return fopen(path, "rbe"); }
static int fp_foreign(const fp_child *child) { return child->parent != getpid(); }

static void fp_shut(int *fd) {
  if (*fd >= 0) close(*fd);
  *fd = -1;
}

/* Above the standard ones, which the process gets anew, and not to be inherited. */
static int fp_lift(int *fd) {
  const int high = fcntl(*fd, F_DUPFD_CLOEXEC, 3);
  close(*fd);
  *fd = high;
  return high < 0 ? -1 : 0;
}

static int fp_pipes(int channel[2], int prints[2]) {
#if defined(__APPLE__)
  if (socketpair(AF_UNIX, SOCK_STREAM, 0, channel)) return -1;
#else
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, channel)) return -1;
#endif
  if (fp_lift(&channel[0]) | fp_lift(&channel[1])) return -1;
#if defined(__APPLE__)
  const int on = 1;
  setsockopt(channel[0], SOL_SOCKET, SO_NOSIGPIPE, &on, sizeof on);
  if (pipe(prints)) return -1;
#else
  if (pipe2(prints, O_CLOEXEC)) return -1;
#endif
  if (fp_lift(&prints[0]) | fp_lift(&prints[1])) return -1;
  return fcntl(prints[0], F_SETFL, O_NONBLOCK) < 0 ? -1 : 0;
}

/* The importer's environment, without what ties Python to the importer's own one. */
static char **fp_variables(void) {
  size_t n = 0, k = 0;
  char **all = FP_ENVIRON;
  while (all && all[n]) n++;
  char **made = calloc(n + 1, sizeof *made);
  if (!made) return 0;
  for (size_t j = 0; j < n; j++)
    if (strncmp(all[j], "PYTHONHOME=", 11) && strncmp(all[j], "__PYVENV_LAUNCHER__=", 20)) made[k++] = all[j];
  return made;
}

static int fp_start(fp_child *child, const char *python, const char *script, char *why) {
  int channel[2] = {-1, -1}, prints[2] = {-1, -1}, error = 0;
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  sigset_t none, usual;
  char *words[] = {(char *)python, (char *)script, 0};
  char **variables = fp_variables();
  if (!variables || fp_pipes(channel, prints)) error = errno ? errno : ENOMEM;
  if (!error) {
    posix_spawn_file_actions_init(&actions);
    posix_spawnattr_init(&attributes);
    posix_spawn_file_actions_adddup2(&actions, channel[1], 0);
    posix_spawn_file_actions_adddup2(&actions, prints[1], 1);
    posix_spawn_file_actions_adddup2(&actions, prints[1], 2);
    /* A group of its own, so that Ctrl-C is the importer's alone; signals as at the start of any program. */
    sigemptyset(&none);
    sigemptyset(&usual);
    for (int signal = 1; signal < 32; signal++)
      if (signal != SIGKILL && signal != SIGSTOP) sigaddset(&usual, signal);
    posix_spawnattr_setpgroup(&attributes, 0);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setsigdefault(&attributes, &usual);
    short flags = POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF;
#if defined(__APPLE__)
    flags |= POSIX_SPAWN_CLOEXEC_DEFAULT;
#endif
    posix_spawnattr_setflags(&attributes, flags);
    error = posix_spawnp(&child->pid, python, &actions, &attributes, words, variables);
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
  }
  free(variables);
  fp_shut(&channel[1]);
  fp_shut(&prints[1]);
  if (error) {
    fp_shut(&channel[0]);
    fp_shut(&prints[0]);
    snprintf(why, FP_WHY, "%s", strerror(error));
    return -1;
  }
  child->parent = getpid();
  child->channel = channel[0];
  child->prints = prints[0];
  child->printed.length = 0;
  return 0;
}

static int fp_listen(fp_child *child) {
  char bytes[4096];
  for (;;) {
    const ssize_t n = child->prints < 0 ? 0 : read(child->prints, bytes, sizeof bytes);
    if (n > 0) fp_hear(&child->printed, bytes, (size_t)n);
    else if (n < 0 && errno == EINTR) continue;
    else if (n < 0 && errno == EAGAIN) return 0;
    else {
      fp_shut(&child->prints);
      return 0;
    }
  }
}

/* Wait until the channel is ready, and hear what is printed meanwhile: a full pipe would stop the process. */
static int fp_wait(fp_child *child, short event) {
  for (;;) {
    struct pollfd looked[2] = {{child->channel, event, 0}, {child->prints, POLLIN, 0}};
    if (poll(looked, 2, -1) < 0) {
      if (errno == EINTR || errno == EAGAIN) continue;
      return -1;
    }
    if (looked[1].revents) fp_listen(child);
    if (looked[0].revents & (event | POLLERR | POLLHUP | POLLNVAL)) return 0;
  }
}

static int fp_send(fp_child *child, const char *bytes, size_t n) {
  while (n) {
    const ssize_t sent = send(child->channel, bytes, n, FP_SEND_FLAGS | MSG_DONTWAIT);
    if (sent >= 0) {
      bytes += sent;
      n -= (size_t)sent;
    } else if (errno == EAGAIN || errno == EWOULDBLOCK) {
      if (fp_wait(child, POLLOUT)) return -1;
    } else if (errno != EINTR) return -1;
  }
  return 0;
}

static int fp_receive(fp_child *child, fp_text *text) {
  if (fp_room(text, 65536) || fp_wait(child, POLLIN)) return -1;
  for (;;) {
    const ssize_t n = recv(child->channel, text->at + text->length, text->capacity - text->length, 0);
    if (n > 0) {
      text->length += (size_t)n;
      return 0;
    }
    if (!n || errno != EINTR) return -1;
  }
}

static void fp_heard(fp_child *child, fp_text *text) {
  fp_append(text, child->printed.at, child->printed.length);
  child->printed.length = 0;
  if (child->pid) return;
  free(child->printed.at);
  child->printed = (fp_text){0, 0, 0};
}

static void fp_finish(fp_child *child, char *why) {
  int status = 0;
  pid_t found = 0;
  snprintf(why, FP_WHY, "and somebody else waited for it");
  if (!fp_foreign(child)) {
    /* One that has closed its pipes is ending with a code that this no longer changes. */
    while ((found = waitpid(child->pid, &status, WNOHANG)) < 0 && errno == EINTR) {}
    if (!found) {
      kill(child->pid, SIGKILL);
      while ((found = waitpid(child->pid, &status, 0)) < 0 && errno == EINTR) {}
    }
    fp_listen(child);
  }
  if (found == child->pid && WIFEXITED(status)) snprintf(why, FP_WHY, "with exit code %d", WEXITSTATUS(status));
  if (found == child->pid && WIFSIGNALED(status))
    snprintf(why, FP_WHY, "by signal %d (%s)", WTERMSIG(status), strsignal(WTERMSIG(status)));
  fp_shut(&child->channel);
  fp_shut(&child->prints);
  child->pid = 0;
}

#if defined(__APPLE__)
static int fp_own_file(char *path, size_t size) {
  Dl_info found;
  if (!dladdr((const void *)&fp_own_file, &found) || !found.dli_fname) return -1;
  return (size_t)snprintf(path, size, "%s", found.dli_fname) < size ? 0 : -1;
}
#else
typedef struct {
  char *path;
  size_t size;
} fp_sought;

static int fp_look(struct dl_phdr_info *info, size_t n, void *given) {
  const fp_sought *sought = given;
  (void)n;
  for (int k = 0; k < info->dlpi_phnum; k++) {
    const ElfW(Phdr) *part = &info->dlpi_phdr[k];
    const uintptr_t at = (uintptr_t)&fp_look - info->dlpi_addr;
    if (part->p_type == PT_LOAD && at >= part->p_vaddr && at < part->p_vaddr + part->p_memsz)
      return (size_t)snprintf(sought->path, sought->size, "%s", info->dlpi_name) < sought->size && *sought->path ? 1 : 2;
  }
  return 0;
}

static int fp_own_file(char *path, size_t size) {
  fp_sought sought = {path, size};
  return dl_iterate_phdr(fp_look, &sought) == 1 ? 0 : -1;
}
#endif
