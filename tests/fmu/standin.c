/* Stands in for a Python on Windows: speaks the language of fmu/heads/process.c, and integrates what it is given.
 *
 *   STANDIN=refuses   is no Python that will do
 *   STANDIN=dies      ends at the third step, with words */

#include <fcntl.h>
#include <io.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SET_REAL = 9, STEP = 11, GET_REAL = 7, CLOSE = 18 };

static void give(uint32_t status, const void *result, uint32_t n) {
  const uint32_t head[3] = {status, 0, n};
  fwrite(head, sizeof head, 1, stdout);
  fwrite(result, 1, n, stdout);
  fflush(stdout);
}

int main(int count, char **words) {
  static const char no[] = "it only stands in";
  static char given[65536];
  const char *manner = getenv("STANDIN") ? getenv("STANDIN") : "";
  uint32_t head[2];
  double u = 0, y[64] = {0};
  int steps = 0;
  _setmode(0, _O_BINARY);
  _setmode(1, _O_BINARY);
  fprintf(stderr, "%s %s\n", words[0], count > 1 ? words[1] : "");
  fwrite("flexarm", 8, 1, stdout);
  give(!strcmp(manner, "refuses") ? 3 : 0, no, !strcmp(manner, "refuses") ? sizeof no - 1 : 0);
  while (fread(head, sizeof head, 1, stdin) && head[1] < sizeof given && fread(given, 1, head[1], stdin) == head[1]) {
    if (head[0] == SET_REAL) memcpy(&u, given + head[1] - 8, 8);
    if (head[0] == STEP) {
      double length;
      memcpy(&length, given + 8, 8);
      for (int k = 0; k < 64; k++) y[k] += u * length;
      for (int k = 0; k < 100; k++) fprintf(stderr, "a line of words that nobody reads may not stop it\n");
      if (++steps == 3 && !strcmp(manner, "dies")) {
        fprintf(stderr, "goodbye\n");
        return 7;
      }
    }
    if (head[0] == GET_REAL) give(0, y, head[1] * 2);
    else give(0, 0, 0);
    if (head[0] == CLOSE) return 0;
  }
  return 1;
}
