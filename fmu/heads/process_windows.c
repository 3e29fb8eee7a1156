/* The Python process of an instance on Windows: its standard input and output are pipes for requests and answers; what it
 * prints goes to its standard error, which a thread reads. A job ends it with the importer. */

#define WIN32_LEAN_AND_MEAN
#include <windows.h>

#define FP_ON_PATH "python.exe"

typedef struct {
  HANDLE process, job, requests, answers, prints, listener;
  CRITICAL_SECTION lock;
  fp_text printed;
} fp_child;

/* Environment variables and paths are UTF-16 there; everything here is UTF-8. */
static wchar_t *fp_wide(const char *text, wchar_t *wide, int size) {
  if (!MultiByteToWideChar(CP_UTF8, 0, text, -1, wide, size)) wide[0] = 0;
  return wide;
}

static const char *fp_environment(const char *name) {
  static __thread char value[FP_PATH];
  wchar_t wide[100], found[FP_PATH];
  const DWORD n = GetEnvironmentVariableW(fp_wide(name, wide, 100), found, FP_PATH);
  if (!n || n >= FP_PATH || !WideCharToMultiByte(CP_UTF8, 0, found, -1, value, FP_PATH, 0, 0)) return 0;
  return value;
}

static FILE *fp_open(const char *path) {
  wchar_t wide[FP_PATH];
  return _wfopen(fp_wide(path, wide, FP_PATH), L"rb");
}

static int fp_foreign(const fp_child *child) {
  (void)child;
  return 0;
}

static void fp_shut(HANDLE *handle) {
  if (*handle) CloseHandle(*handle);
  *handle = 0;
}

static DWORD WINAPI fp_listen(void *given) {
  fp_child *child = given;
  char bytes[4096];
  DWORD n;
  while (ReadFile(child->prints, bytes, sizeof bytes, &n, 0) && n) {
    EnterCriticalSection(&child->lock);
    fp_hear(&child->printed, bytes, n);
    LeaveCriticalSection(&child->lock);
  }
  return 0;
}

/* A pipe whose one end can be inherited. */
static int fp_pipe(HANDLE *own, HANDLE *its, int it_reads) {
  HANDLE reads, writes;
  if (!CreatePipe(&reads, &writes, 0, 65536)) return -1;
  *own = it_reads ? writes : reads;
  *its = it_reads ? reads : writes;
  return SetHandleInformation(*its, HANDLE_FLAG_INHERIT, HANDLE_FLAG_INHERIT) ? 0 : -1;
}

/* The first file of that name in a folder of PATH that is given whole: never in the current folder. */
static int fp_on_path(const wchar_t *name, wchar_t *found, size_t size) {
  static const DWORD most = 32768;
  wchar_t *all = malloc(most * sizeof *all);
  int known = 0;
  const DWORD n = all ? GetEnvironmentVariableW(L"PATH", all, most) : 0;
  if (n && n < most)
    for (wchar_t *at = all, *next; at && !known; at = next) {
      next = wcschr(at, L';');
      if (next) *next++ = 0;
      if (!*at || (at[1] != L':' && at[0] != L'\\') || wcslen(at) + wcslen(name) + 2 > size) continue;
      wcscpy(found, at);
      if (found[wcslen(found) - 1] != L'\\') wcscat(found, L"\\");
      wcscat(found, name);
      const DWORD kind = GetFileAttributesW(found);
      known = kind != INVALID_FILE_ATTRIBUTES && !(kind & FILE_ATTRIBUTE_DIRECTORY);
    }
  free(all);
  return known ? 0 : -1;
}

/* The importer's environment, without what ties Python to the importer's own one. */
static wchar_t *fp_variables(void) {
  wchar_t *all = GetEnvironmentStringsW(), *end = all;
  if (!all) return 0;
  while (*end) end += wcslen(end) + 1;
  wchar_t *made = malloc(((size_t)(end - all) + 2) * sizeof *made), *to = made;
  for (wchar_t *at = all; made && *at; at += wcslen(at) + 1)
    if (wcsncmp(at, L"PYTHONHOME=", 11)) {
      wcscpy(to, at);
      to += wcslen(at) + 1;
    }
  if (made) to[0] = to[1] = 0;
  FreeEnvironmentStringsW(all);
  return made;
}

static void fp_error_text(DWORD code, char *why) {
  wchar_t wide[FP_WHY / 4];
  if (!FormatMessageW(FORMAT_MESSAGE_FROM_SYSTEM | FORMAT_MESSAGE_IGNORE_INSERTS, 0, code, 0, wide, FP_WHY / 4, 0) ||
      !WideCharToMultiByte(CP_UTF8, 0, wide, -1, why, FP_WHY, 0, 0))
    snprintf(why, FP_WHY, "error %lu", code);
  why[strcspn(why, "\r\n")] = 0;
}

static int fp_start(fp_child *child, const char *python, const char *script, char *why) {
  wchar_t program[FP_PATH], file[FP_PATH], line[2 * FP_PATH + 10];
  HANDLE inherited[3] = {0, 0, 0};
  STARTUPINFOEXW start = {0};
  PROCESS_INFORMATION made = {0};
  JOBOBJECT_EXTENDED_LIMIT_INFORMATION limits = {0};
  SIZE_T size = 0;
  fp_wide(python, program, FP_PATH);
  fp_wide(script, file, FP_PATH);
  if (!strcmp(python, FP_ON_PATH) && fp_on_path(L"python.exe", program, FP_PATH)) {
    snprintf(why, FP_WHY, "there is none");
    return -1;
  }
  memset(child, 0, offsetof(fp_child, lock));
  wchar_t *variables = fp_variables();
  int sound = variables && !fp_pipe(&child->requests, &inherited[0], 1) && !fp_pipe(&child->answers, &inherited[1], 0) &&
              !fp_pipe(&child->prints, &inherited[2], 0);
  InitializeProcThreadAttributeList(0, 1, 0, &size);
  start.lpAttributeList = malloc(size);
  sound = sound && start.lpAttributeList && InitializeProcThreadAttributeList(start.lpAttributeList, 1, 0, &size);
  if (sound) {
    start.StartupInfo.cb = sizeof start;
    start.StartupInfo.dwFlags = STARTF_USESTDHANDLES;
    start.StartupInfo.hStdInput = inherited[0];
    start.StartupInfo.hStdOutput = inherited[1];
    start.StartupInfo.hStdError = inherited[2];
    _snwprintf(line, sizeof line / sizeof *line, L"\"%ls\" \"%ls\"", program, file);
    child->job = CreateJobObjectW(0, 0);
    limits.BasicLimitInformation.LimitFlags = JOB_OBJECT_LIMIT_KILL_ON_JOB_CLOSE;
    if (child->job) SetInformationJobObject(child->job, JobObjectExtendedLimitInformation, &limits, sizeof limits);
    sound = UpdateProcThreadAttribute(start.lpAttributeList, 0, PROC_THREAD_ATTRIBUTE_HANDLE_LIST, inherited,
                                      sizeof inherited, 0, 0) &&
            CreateProcessW(program, line, 0, 0, TRUE,
                           CREATE_NO_WINDOW | CREATE_NEW_PROCESS_GROUP | CREATE_SUSPENDED | CREATE_UNICODE_ENVIRONMENT |
                               EXTENDED_STARTUPINFO_PRESENT,
                           variables, 0, &start.StartupInfo, &made);
    if (!sound) fp_error_text(GetLastError(), why);
    DeleteProcThreadAttributeList(start.lpAttributeList);
  } else fp_error_text(GetLastError(), why);
  free(start.lpAttributeList);
  free(variables);
  for (int k = 0; k < 3; k++) fp_shut(&inherited[k]);
  if (!sound) {
    fp_shut(&child->requests);
    fp_shut(&child->answers);
    fp_shut(&child->prints);
    fp_shut(&child->job);
    return -1;
  }
  if (child->job) AssignProcessToJobObject(child->job, made.hProcess);   /* before its first step, so its children too */
  ResumeThread(made.hThread);
  CloseHandle(made.hThread);
  child->process = made.hProcess;
  child->printed.length = 0;
  InitializeCriticalSection(&child->lock);
  child->listener = CreateThread(0, 0, fp_listen, child, 0, 0);
  return 0;
}

static int fp_send(fp_child *child, const char *bytes, size_t n) {
  while (n) {
    DWORD sent;
    if (!WriteFile(child->requests, bytes, n > 65536 ? 65536 : (DWORD)n, &sent, 0)) return -1;
    bytes += sent;
    n -= sent;
  }
  return 0;
}

static int fp_receive(fp_child *child, fp_text *text) {
  DWORD n;
  if (fp_room(text, 65536) || !ReadFile(child->answers, text->at + text->length, 65536, &n, 0) || !n) return -1;
  text->length += n;
  return 0;
}

static void fp_heard(fp_child *child, fp_text *text) {
  if (child->process) EnterCriticalSection(&child->lock);
  fp_append(text, child->printed.at, child->printed.length);
  child->printed.length = 0;
  if (child->process) {
    LeaveCriticalSection(&child->lock);
    return;
  }
  free(child->printed.at);
  child->printed = (fp_text){0, 0, 0};
}

static void fp_finish(fp_child *child, char *why) {
  DWORD code = 0;
  fp_shut(&child->requests);                            /* closed pipes end it; one that is ending keeps its code */
  if (WaitForSingleObject(child->process, 0) == WAIT_TIMEOUT) {
    DWORD gone;
    char byte;
    while (ReadFile(child->answers, &byte, 1, &gone, 0) && gone) {}
    if (!child->job || !TerminateJobObject(child->job, 1)) TerminateProcess(child->process, 1);
  }
  WaitForSingleObject(child->process, INFINITE);
  GetExitCodeProcess(child->process, &code);
  snprintf(why, FP_WHY, code > 0xffff ? "with exit code 0x%lx" : "with exit code %lu", code);
  if (child->job) TerminateJobObject(child->job, 1);    /* what it has started may hold the pipe of its prints */
  fp_shut(&child->job);
  if (child->listener) {
    WaitForSingleObject(child->listener, INFINITE);
    fp_shut(&child->listener);
  }
  fp_shut(&child->answers);
  fp_shut(&child->prints);
  fp_shut(&child->process);
  DeleteCriticalSection(&child->lock);
}

static int fp_own_file(char *path, size_t size) {
  wchar_t wide[FP_PATH];
  HMODULE library;
  if (!GetModuleHandleExW(GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS | GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT,
                          (const wchar_t *)&fp_own_file, &library))
    return -1;
  const DWORD n = GetModuleFileNameW(library, wide, FP_PATH);
  return n && n < FP_PATH && WideCharToMultiByte(CP_UTF8, 0, wide, -1, path, (int)size, 0, 0) ? 0 : -1;
}
